// SPDX-License-Identifier: Apache-2.0
// The page of a program that was built without Node.js, which makes the real one.
#include "tools/report/report_page.h"

namespace fringeslam::tools {

std::string_view live_page() {
  return R"(<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><title>Live · FringeSLAM</title><link rel="icon" href="data:,"></head>
<body>
<p>This program was built without its pages (FRINGESLAM_REPORT=OFF). What they show is at
<a href="/snapshot">/snapshot</a> and, for the number of the newest view in it, at /picture/NUMBER/texture.jpg,
modulation.jpg, saturation.png and depth.png.</p>
</body>
</html>
)";
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// Placeholder page for builds without Node.js, which generates the real one.
#include "tools/report/report_page.h"

namespace fringeslam::tools {

std::string_view live_page() {
  return R"(<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><title>Live · FringeSLAM</title><link rel="icon" href="data:,"></head>
<body>
<p>This program was built without its pages (FRINGESLAM_REPORT=OFF). Their data is at
<a href="/snapshot">/snapshot</a> and, for the newest view's number given there, at /picture/NUMBER/texture.jpg,
modulation.jpg, saturation.png and depth.png.</p>
</body>
</html>
)";
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// The page without data, in the source that the build makes of page/.
#pragma once

#include <string_view>

namespace fringeslam::tools {

// Holds each of these once, in this order, to be replaced: the title, then the data.
inline constexpr std::string_view kTitlePlace = "@@TITLE@@";
inline constexpr std::string_view kDataPlace = "@@DATA@@";

std::string_view report_page();

}  // namespace fringeslam::tools

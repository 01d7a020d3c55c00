// SPDX-License-Identifier: Apache-2.0
// The pages without data, in the sources that the build makes of page/.
#pragma once

#include <string_view>

namespace fringeslam::tools {

// The first two hold each of these once, in this order, to be replaced: the title, then the data.
inline constexpr std::string_view kTitlePlace = "@@TITLE@@";
inline constexpr std::string_view kDataPlace = "@@DATA@@";

std::string_view report_page();  // about a run
std::string_view study_page();   // about a study
std::string_view live_page();    // of what is captured or mapped just now; it asks its server for the data

}  // namespace fringeslam::tools

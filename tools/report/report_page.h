// SPDX-License-Identifier: Apache-2.0
// The pages without their data, compiled in from sources that the build generates from page/.
#pragma once

#include <string_view>

namespace fringeslam::tools {

// Placeholders: the first two pages contain each of these once, in this order: the title, then the data.
inline constexpr std::string_view kTitlePlace = "@@TITLE@@";
inline constexpr std::string_view kDataPlace = "@@DATA@@";

std::string_view report_page();  // about a run
std::string_view study_page();   // about a study
std::string_view live_page();    // of a capture or run in progress; it requests its data from the server
std::string_view world_page();   // of a scene; likewise
std::string_view gallery_page();  // of a folder of scenes; likewise

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// report.html: the page of page/ with a run's data in it, one file that needs nothing else.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace fringeslam::tools {

// JSON that can stand in a <script> element: no "<" in it, whatever a name holds.
std::string script_json(const nlohmann::ordered_json& data);

std::string html_report(const nlohmann::ordered_json& data);

// Writes the page of a run folder, whole or not at all. Throws Error as report_data() does.
void write_report(const std::filesystem::path& run, const std::filesystem::path& file);

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// report.html: a page of page/ with its data in it, one file that needs nothing else.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace fringeslam::tools {

// JSON that can stand in a <script> element: no "<" in it, whatever a name holds.
std::string script_json(const nlohmann::ordered_json& data);

// `page`: one of report_page.h. Its title is data["name"].
std::string html_report(std::string_view page, const nlohmann::ordered_json& data);

// Writes it, whole or not at all.
void write_html(const std::filesystem::path& file, const std::string& html);

// Writes the page of a run folder, whole or not at all. Throws Error as report_data() does.
void write_report(const std::filesystem::path& run, const std::filesystem::path& file);

}  // namespace fringeslam::tools

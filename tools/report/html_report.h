// SPDX-License-Identifier: Apache-2.0
// report.html: a page of page/ with its data embedded, one self-contained file.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace fringeslam::tools {

// Serializes JSON for a <script> element: it contains no "<", whatever the names are.
std::string script_json(const nlohmann::ordered_json& data);

// Inserts the data into `page`, one of report_page.h. The title is data["name"].
std::string html_report(std::string_view page, const nlohmann::ordered_json& data);

// Writes the file atomically.
void write_html(const std::filesystem::path& file, const std::string& html);

// Writes the page of a run folder atomically. Throws Error like report_data().
void write_report(const std::filesystem::path& run, const std::filesystem::path& file);

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "tools/report/html_report.h"

#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/types/error.h"
#include "tools/report/report_data.h"
#include "tools/report/report_page.h"

namespace fringeslam::tools {

namespace {

std::string html_text(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      default:
        safe += c;
    }
  }
  return safe;
}

}  // namespace

std::string script_json(const nlohmann::ordered_json& data) {
  // Names come from files and may contain invalid UTF-8.
  const std::string text = json_text(data);
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) c == '<' ? safe += "\\u003c" : safe += c;
  return safe;
}

std::string html_report(std::string_view page, const nlohmann::ordered_json& data) {
  const size_t title = page.find(kTitlePlace), place = page.find(kDataPlace);
  if (title == page.npos || place == page.npos || place < title)
    throw Error("report: the page has no placeholders for its title and data");
  const nlohmann::ordered_json name = data.at("name");
  std::string html(page.substr(0, title));
  // Dumping to JSON and back replaces invalid UTF-8.
  const std::string quoted = json_text(name);
  html += html_text(nlohmann::json::parse(quoted).get<std::string>());
  html += page.substr(title + kTitlePlace.size(), place - title - kTitlePlace.size());
  html += script_json(data);
  html += page.substr(place + kDataPlace.size());
  return html;
}

void write_html(const std::filesystem::path& file, const std::string& html) {
  StagedFile staged(file);
  write_text(staged.path(), html);
  staged.commit();
}

void write_report(const std::filesystem::path& run, const std::filesystem::path& file) {
  write_html(file, html_report(report_page(), report_data(run)));
}

}  // namespace fringeslam::tools

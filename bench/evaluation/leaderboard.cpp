// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/leaderboard.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/json_text.h"
#include "core/types/error.h"

namespace fringeslam::evaluation {

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kResultsFile = "results.jsonl";

// Visits all fields by name, for JSON and CSV.
template <class Value, class Visit>
void for_each_field(Value& r, Visit&& visit) {
  visit("suite", r.suite);
  visit("dataset", r.dataset);
  visit("system", r.system);
  visit("end", r.end);
  visit("views", r.views);
  visit("poses", r.poses);
  visit("ate_m", r.ate_m);
  visit("ate_origin_m", r.ate_origin_m);
  visit("rpe_m", r.rpe_m);
  visit("rpe_rad", r.rpe_rad);
  visit("precision", r.precision);
  visit("recall", r.recall);
  visit("f_score", r.f_score);
  visit("threshold_m", r.threshold_m);
  visit("seconds", r.seconds);
  visit("peak_mib", r.peak_mib);
  visit("message", r.message);
  visit("command", r.command);
  visit("dataset_hash", r.dataset_hash);
  visit("timeout_s", r.timeout_s);
  visit("memory_mib", r.memory_mib);
}

void make_folder(const std::filesystem::path& folder) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure) throw Error(folder.string() + ": cannot be created: " + failure.message());
}

// Exclusive access to a folder among processes; the system releases it when the process ends.
class FolderLock {
 public:
  explicit FolderLock(const std::filesystem::path& folder) : descriptor_(open(folder.c_str(), O_RDONLY | O_DIRECTORY)) {
    if (descriptor_ < 0 || flock(descriptor_, LOCK_EX) != 0) throw Error(folder.string() + ": cannot be locked");
  }
  ~FolderLock() { close(descriptor_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}
std::string csv_field(int value) { return std::to_string(value); }
std::string csv_field(double value) {
  if (std::isnan(value)) return "";
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string escaped(const std::string& text) {
  std::string html;
  for (const char c : text) {
    switch (c) {
      case '&':
        html += "&amp;";
        break;
      case '<':
        html += "&lt;";
        break;
      case '>':
        html += "&gt;";
        break;
      case '"':
        html += "&quot;";
        break;
      default:
        html += c;
    }
  }
  return html;
}

std::string number(double value, double factor = 1) {
  if (std::isnan(value)) return "–";
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value * factor);
  return text;
}

std::string html_cell(const MedianInterval& q, double factor) {
  if (std::isnan(q.median)) return "<td data-value=\"\">–</td>";
  return "<td data-value=\"" + number(q.median, factor) + "\">" + number(q.median, factor) + " <small>" +
         number(q.low, factor) + "–" + number(q.high, factor) + "</small></td>";
}

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0f", 100 * share);
  return text;
}

constexpr const char* kPageHead = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Leaderboard</title><style>
:root { color-scheme: light dark; --line: #8884; --note: #667; }
@media (prefers-color-scheme: dark) { :root { --note: #aab; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 82rem; padding: 0 1rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { border-bottom: 1px solid var(--line); padding: .35rem .6rem; text-align: right; white-space: nowrap; }
th:first-child, td:first-child, .name, .text { text-align: left; }
.text { white-space: normal; overflow-wrap: anywhere; }
th button { all: unset; cursor: pointer; } th button:focus-visible { outline: 2px solid; }
small, p.note { color: var(--note); }
td small { display: block; }
</style></head><body>
<h1>Leaderboard</h1>
<p class="note">Medians over the datasets of a suite with 95 % bootstrap intervals. ATE: RMS position error after the
best rigid alignment; RPE: RMS error of the motion between consecutive poses; F-score of the map within THRESHOLDS;
tracked: views with a pose, over all datasets. Errors are those of the poses that a system reports: compare
them together with the share of tracked views. Select a column to sort by it.</p>
)";

constexpr const char* kPageEnd = R"(<script>
for (const button of document.querySelectorAll("th button")) button.onclick = () => {
  const header = button.parentElement, table = header.closest("table"), column = header.cellIndex;
  const descending = header.ariaSort === "ascending";
  const value = row => { const v = row.cells[column].dataset.value ?? row.cells[column].textContent;
    return v === "" ? Infinity : isNaN(v) ? v : Number(v); };
  const rows = [...table.tBodies[0].rows].sort((a, b) => value(a) < value(b) ? -1 : value(a) > value(b) ? 1 : 0);
  if (descending) rows.reverse();
  table.tBodies[0].append(...rows);
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  header.ariaSort = descending ? "descending" : "ascending";
};
</script></body></html>
)";

void append_standings(std::string& html, const std::vector<Standing>& standings) {
  for (size_t i = 0; i < standings.size(); ++i) {
    const Standing& s = standings[i];
    if (i == 0 || standings[i - 1].suite != s.suite) {
      html += "<h2>" + escaped(s.suite) + "</h2><div class=\"scroll\"><table><thead><tr>";
      for (const char* head :
           {"system", "datasets", "tracked, %", "ATE, mm", "RPE, mm", "RPE, °", "F-score", "s per view", "memory, MiB"})
        html += std::string("<th><button>") + head + "</button></th>";
      html += "</tr></thead><tbody>\n";
    }
    html += "<tr><td>" + escaped(s.system) + "</td><td data-value=\"" + std::to_string(s.scored) + "\">" +
            std::to_string(s.scored) + " of " + std::to_string(s.datasets) + "</td><td>" + percent(s.tracked) +
            "</td>" + html_cell(s.ate_m, 1e3) + html_cell(s.rpe_m, 1e3) + html_cell(s.rpe_rad, 180 / M_PI) +
            html_cell(s.f_score, 1) + html_cell(s.seconds_per_view, 1) + html_cell(s.peak_mib, 1) + "</tr>\n";
    if (i + 1 == standings.size() || standings[i + 1].suite != s.suite) html += "</tbody></table></div>\n";
  }
}

}  // namespace

std::vector<Standing> standings_of(const std::vector<Result>& results) {
  std::map<std::pair<std::string, std::string>, std::vector<const Result*>> groups;
  for (const Result& result : results) groups[{result.suite, result.system}].push_back(&result);
  std::vector<Standing> standings;
  for (const auto& entry : groups) {
    const std::vector<const Result*>& group = entry.second;
    Standing s;
    std::tie(s.suite, s.system) = entry.first;
    s.datasets = static_cast<int>(group.size());
    const auto quantity = [&](auto&& value) {
      std::vector<double> values;
      for (const Result* result : group) values.push_back(value(*result));
      values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return std::isnan(v); }), values.end());
      return median_interval_of(values);
    };
    for (const Result* result : group) {
      s.scored += result->has_trajectory();
      s.tracked += result->tracked() / static_cast<double>(group.size());
    }
    s.ate_m = quantity([](const Result& r) { return r.ate_m; });
    s.rpe_m = quantity([](const Result& r) { return r.rpe_m; });
    s.rpe_rad = quantity([](const Result& r) { return r.rpe_rad; });
    s.f_score = quantity([](const Result& r) { return r.f_score; });
    s.seconds_per_view = quantity([](const Result& r) { return r.has_trajectory() ? r.seconds / r.views : kNone; });
    s.peak_mib = quantity([](const Result& r) { return r.peak_mib; });
    standings.push_back(s);
  }
  const auto better = [](const Standing& a, const Standing& b) {
    if (a.suite != b.suite) return a.suite < b.suite;
    if (a.scored * b.datasets != b.scored * a.datasets) return a.scored * b.datasets > b.scored * a.datasets;
    const auto percent_of = [](const Standing& s) { return std::lround(100 * s.tracked); };
    if (percent_of(a) != percent_of(b)) return percent_of(a) > percent_of(b);
    if (std::isnan(a.ate_m.median) != std::isnan(b.ate_m.median)) return std::isnan(b.ate_m.median);
    return a.ate_m.median < b.ate_m.median;
  };
  std::stable_sort(standings.begin(), standings.end(), better);
  return standings;
}

std::string to_lines(const std::vector<Result>& results) {
  std::string lines;
  for (const Result& result : results) {
    Json json;
    for_each_field(result, [&](const char* name, const auto& value) { json[name] = value; });
    lines += json_text(json) + "\n";
  }
  return lines;
}

std::vector<Result> read_results(const std::filesystem::path& file) {
  std::vector<Result> results;
  std::istringstream stream(read_input(file));
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    try {
      const Json json = Json::parse(line);
      Result result;
      for_each_field(result, [&](const char* name, auto& value) {
        const std::string_view key = name;
        if (!json.contains(key) && (key == "timeout_s" || key == "memory_mib")) return;  // of earlier versions
        const Json& field = json.at(name);
        if (!field.is_null()) field.get_to(value);
      });
      results.push_back(std::move(result));
    } catch (const Json::exception&) {
      throw Error(file.string() + ":" + std::to_string(number) +
                  ": is not a result of `fringeslam evaluate`; remove the line or choose another --out");
    }
  }
  return results;
}

namespace {

// True if the folder contains anything but what a killed process left before its first result.
bool has_other_files(const std::filesystem::path& folder) {
  std::error_code failed;
  for (std::filesystem::directory_iterator entry(folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    const std::string name = entry->path().filename().string();
    if (with_final_names(name) == name) return true;
  }
  return false;
}

}  // namespace

std::vector<Result> results_in(const std::filesystem::path& folder) {
  std::error_code ignored;
  if (std::filesystem::exists(folder, ignored) && !std::filesystem::is_directory(folder, ignored))
    throw Error(folder.string() + ": is a file; choose another folder");
  if (std::filesystem::exists(folder / kResultsFile, ignored)) return read_results(folder / kResultsFile);
  if (has_other_files(folder))
    throw Error(folder.string() + ": contains other files and no " + kResultsFile + "; choose another folder");
  return {};
}

void write_results(const std::filesystem::path& folder, const std::vector<Result>& results) {
  make_folder(folder);
  const auto write = [&](const std::string& name, const std::string& text) {
    StagedFile file(folder / name);
    write_text(file.path(), text);
    file.commit();
  };
  write(kResultsFile, to_lines(results));
  write("leaderboard.csv", to_csv(results));
  write("leaderboard.html", to_html(results));
}

std::vector<Result> open_results(const std::filesystem::path& folder) {
  make_folder(folder);
  const FolderLock lock(folder);
  std::vector<Result> results = results_in(folder);
  write_results(folder, results);
  return results;
}

void add_result(const std::filesystem::path& folder, const Result& result) {
  make_folder(folder);
  const FolderLock lock(folder);
  std::vector<Result> results = results_in(folder);
  put(results, result);
  write_results(folder, results);
}

void set_score(Result& result, const TrajectoryScore& score) {
  result.poses = score.poses;
  result.ate_m = score.ate_umeyama_rmse_m;
  result.ate_origin_m = score.ate_rmse_m;
  result.rpe_m = score.rpe_translation_rmse_m;
  result.rpe_rad = score.rpe_rotation_rmse_rad;
}

void put(std::vector<Result>& results, const Result& result) {
  for (Result& other : results) {
    if (other.suite == result.suite && other.dataset == result.dataset && other.system == result.system) {
      other = result;
      return;
    }
  }
  results.push_back(result);
}

std::string to_csv(const std::vector<Result>& results) {
  std::string csv;
  const Result names;
  for_each_field(names, [&](const char* name, const auto&) { csv += (csv.empty() ? "" : ",") + std::string(name); });
  csv += "\n";
  for (const Result& result : results) {
    std::string row;
    bool first = true;
    for_each_field(result, [&](const char*, const auto& value) {
      row += (first ? "" : ",") + csv_field(value);
      first = false;
    });
    csv += row + "\n";
  }
  return csv;
}

std::string to_html(const std::vector<Result>& results) {
  std::set<std::string> thresholds;
  for (const Result& r : results) {
    if (!std::isnan(r.threshold_m)) thresholds.insert(number(r.threshold_m, 1e3) + " mm");
  }
  std::string within;
  for (const std::string& threshold : thresholds) within += (within.empty() ? "" : " or ") + threshold;
  std::string html = kPageHead;
  const std::string place = "THRESHOLDS";
  html.replace(html.find(place), place.size(), within.empty() ? "a threshold" : within);
  append_standings(html, standings_of(results));
  std::string failures;
  for (const Result& r : results) {
    if (r.has_trajectory() && r.message.empty()) continue;
    failures += "<tr><td>" + escaped(r.system) + "</td><td class=\"name\">" + escaped(r.suite + "/" + r.dataset) +
                "</td><td class=\"name\">" + escaped(r.end) + "</td><td class=\"text\">" + escaped(r.message) +
                "</td></tr>\n";
  }
  html += "<h2>Failures</h2>\n";
  html += failures.empty() ? "<p>None.</p>\n"
                           : "<div class=\"scroll\"><table><thead><tr><th>system</th><th class=\"name\">dataset</th>"
                             "<th class=\"name\">end</th><th class=\"name\">reason</th></tr></thead><tbody>\n" +
                                 failures + "</tbody></table></div>\n";
  std::map<std::string, std::string> commands;
  for (const Result& r : results) commands[r.system] = r.command;
  html += "<h2>Commands</h2><div class=\"scroll\"><table><tbody>\n";
  for (const auto& [system, command] : commands)
    html += "<tr><td>" + escaped(system) + "</td><td class=\"text\"><code>" + escaped(command) + "</code></td></tr>\n";
  return html + "</tbody></table></div>\n" + kPageEnd;
}

std::string to_table(const std::vector<Standing>& standings) {
  std::string table;
  char line[256];
  std::snprintf(line, sizeof line, "%-12s %-24s %9s %8s %9s %9s %8s %8s %9s %8s\n", "suite", "system", "datasets",
                "tracked", "ATE mm", "RPE mm", "RPE deg", "F-score", "s/view", "MiB");
  table += line;
  for (const Standing& s : standings) {
    const std::string count = std::to_string(s.scored) + "/" + std::to_string(s.datasets);
    std::snprintf(line, sizeof line, "%-12s %-24s %9s %7s%% %9s %9s %8s %8s %9s %8s\n", s.suite.c_str(),
                  s.system.c_str(), count.c_str(), percent(s.tracked).c_str(), number(s.ate_m.median, 1e3).c_str(),
                  number(s.rpe_m.median, 1e3).c_str(), number(s.rpe_rad.median, 180 / M_PI).c_str(),
                  number(s.f_score.median).c_str(), number(s.seconds_per_view.median).c_str(),
                  number(s.peak_mib.median).c_str());
    table += line;
  }
  return table;
}

}  // namespace fringeslam::evaluation

// SPDX-License-Identifier: Apache-2.0
#include "tools/report/study_data.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "core/score/score.h"
#include "tools/shell.h"

namespace fringeslam::tools {

namespace {

using namespace studies;
using nlohmann::ordered_json;
using Law = Parameter::Law;

// Rounds to six digits, more than a chart can show; NaN becomes null.
ordered_json rounded(double value) {
  if (!std::isfinite(value)) return nullptr;
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return std::strtod(text, nullptr);
}

ordered_json parameter_json(const Parameter& parameter, size_t p, const std::vector<Row>& rows) {
  ordered_json json = {{"name", parameter.name},
                       {"law", studies::to_string(parameter.law)},
                       {"logarithmic", parameter.logarithmic()},
                       {"whole", parameter.whole},
                       {"values", parameter.values},
                       {"low", nullptr},
                       {"high", nullptr}};
  if (!parameter.values.empty()) return json;
  double low = parameter.a, high = parameter.b;
  if (parameter.law == Law::normal) {
    const auto [least, most] = std::minmax_element(
        rows.begin(), rows.end(), [&](const Row& a, const Row& b) { return a.numbers[p] < b.numbers[p]; });
    if (least == rows.end()) return json;
    low = least->numbers[p], high = most->numbers[p];
  }
  json["low"] = rounded(low), json["high"] = rounded(high);
  return json;
}

ordered_json distribution(const std::vector<Row>& rows, double Row::*error, size_t most_points) {
  std::vector<double> errors;
  for (const Row& row : rows) {
    if (std::isfinite(row.*error)) errors.push_back(row.*error);
  }
  std::sort(errors.begin(), errors.end());
  const size_t count = errors.size(), points = std::min(count, most_points);
  ordered_json json = {{"count", count}, {"none", rows.size() - count}};
  json["percentiles"] = json["points"] = ordered_json::array();
  for (const double q : {0.5, 0.9, 0.99}) {
    if (count > 0) json["percentiles"].push_back({100 * q, rounded(quantile_of(errors, q))});
  }
  for (size_t i = 1; i <= points; ++i) {
    const size_t place = i * count / points;  // the last is the largest
    json["points"].push_back({rounded(errors[place - 1]), static_cast<double>(place) / static_cast<double>(count)});
  }
  return json;
}

ordered_json keys_of(const std::map<std::string, int>& counts) {
  ordered_json keys = ordered_json::array();
  for (const auto& [key, count] : counts) keys.push_back(key);
  return keys;
}

int place_in(const std::map<std::string, int>& counts, const std::string& key) {
  const auto found = counts.find(key);
  return found == counts.end() ? -1 : static_cast<int>(std::distance(counts.begin(), found));
}

ordered_json value_json(const Parameter& parameter, size_t p, const Row& row) {
  if (parameter.values.empty()) return rounded(row.numbers[p]);
  const auto place = std::find(parameter.values.begin(), parameter.values.end(), row.values[p]);
  return place - parameter.values.begin();
}

ordered_json trials_json(const Study& study, const std::vector<Row>& rows, const Summary& summary,
                         const std::vector<WorstTrial>& worst, size_t most) {
  std::set<int> named;
  for (const WorstTrial& trial : worst) named.insert(trial.trial);
  const size_t every = std::max<size_t>(1, (rows.size() + most - 1) / most);
  ordered_json json = {{"every", every}, {"outcomes", keys_of(summary.outcomes)}, {"causes", keys_of(summary.causes)}};
  for (const char* column : {"trial", "outcome", "cause", "translation_mm", "rotation_deg"})
    json[column] = ordered_json::array();
  json["values"] = ordered_json(study.parameters.size(), ordered_json::array());
  for (size_t r = 0; r < rows.size(); ++r) {
    const Row& row = rows[r];
    if (r % every != 0 && !named.contains(row.trial)) continue;
    json["trial"].push_back(row.trial);
    json["outcome"].push_back(place_in(summary.outcomes, row.outcome));
    json["cause"].push_back(place_in(summary.causes, row.cause));
    json["translation_mm"].push_back(rounded(row.translation_mm));
    json["rotation_deg"].push_back(rounded(row.rotation_deg));
    for (size_t p = 0; p < study.parameters.size(); ++p)
      json["values"][p].push_back(value_json(study.parameters[p], p, row));
  }
  return json;
}

ordered_json worst_json(const WorstTrial& worst, const std::vector<Row>& rows, const ordered_json& pictures) {
  ordered_json json = {{"trial", worst.trial},
                       {"outcome", worst.outcome},
                       {"cause", worst.cause},
                       {"translation_mm", rounded(worst.translation_mm)},
                       {"command", worst.command}};
  const auto row = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.trial == worst.trial; });
  if (row != rows.end()) {
    json["message"] = row->message;
    json["values"] = row->values;
  }
  json.update(pictures);
  return json;
}

}  // namespace

std::vector<WorstTrial> pictured_trials(const Summary& summary, int count) {
  std::vector<WorstTrial> chosen;
  for (const auto& list : {summary.worst_of_causes, summary.worst}) {
    for (const WorstTrial& trial : list) {
      const bool is_new = std::none_of(chosen.begin(), chosen.end(),
                                       [&](const WorstTrial& other) { return other.trial == trial.trial; });
      if (is_new && static_cast<int>(chosen.size()) < count) chosen.push_back(trial);
    }
  }
  return chosen;
}

ordered_json study_data(const Study& study, const std::vector<Row>& rows, const Summary& summary,
                        const std::vector<WorstTrial>& worst, const std::map<int, ordered_json>& pictures,
                        const StudyLimits& limits) {
  ordered_json json = {{"version", FRINGESLAM_VERSION},
                       {"name", study.name},
                       {"description", study.description},
                       {"seed", std::to_string(study.seed)},  // JavaScript's numbers end at 2^53
                       {"hash", hash_text(study)},
                       {"scene", study.scene.filename().string()},
                       {"design", study.design == Design::saltelli ? "saltelli" : "random"},
                       {"planned", study.trials},
                       {"replay", "fringeslam study replay " + quoted(study.file.string()) + " --trial "},
                       {"summary", to_json(summary)}};
  json["rule"] = {{"max_translation_mm", 1e3 * study.success.max_translation_m},
                  {"max_rotation_deg", study.success.max_rotation_deg},
                  {"min_valid", study.success.min_valid},
                  {"max_depth_mm", 1e3 * study.success.max_depth_m},
                  {"max_wrong_order", study.success.max_wrong_order},
                  {"max_beyond_4_sigma", study.success.max_beyond_4_sigma}};
  json["parameters"] = json["worst"] = ordered_json::array();
  for (size_t p = 0; p < study.parameters.size(); ++p)
    json["parameters"].push_back(parameter_json(study.parameters[p], p, rows));
  json["curves"] = {{"translation_mm", distribution(rows, &Row::translation_mm, limits.curve_points)},
                    {"rotation_deg", distribution(rows, &Row::rotation_deg, limits.curve_points)}};
  json["trials"] = trials_json(study, rows, summary, worst, limits.trials);
  for (const WorstTrial& trial : worst) {
    const auto found = pictures.find(trial.trial);
    json["worst"].push_back(worst_json(trial, rows, found == pictures.end() ? ordered_json::object() : found->second));
  }
  return json;
}

}  // namespace fringeslam::tools

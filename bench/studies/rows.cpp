// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/rows.h"

#include <nlohmann/json.hpp>

#include "core/base/constants.h"

namespace fringeslam::studies {

namespace {

using Json = nlohmann::json;

double number_or_nan(const Json& json) { return json.is_number() ? json.get<double>() : kNaN; }

}  // namespace

std::vector<Row> rows_of(const Study& study, const std::map<int, std::string>& lines) {
  std::vector<Row> rows;
  for (const auto& [trial, line] : lines) {
    const Json json = Json::parse(line);
    Row row;
    row.trial = trial;
    row.outcome = json.at("outcome");
    row.success = row.outcome == "success";
    row.cause = json.value("cause", "");
    row.message = json.value("message", "");
    const Json metrics = json.value("metrics", Json::object());
    row.translation_mm = number_or_nan(metrics.value("translation_mm", Json()));
    row.rotation_deg = number_or_nan(metrics.value("rotation_deg", Json()));
    for (const Parameter& parameter : study.parameters) {
      row.values.push_back(json.at("values").at(parameter.name));
      row.numbers.push_back(number_or_nan(Json::parse(row.values.back(), nullptr, false)));
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace fringeslam::studies

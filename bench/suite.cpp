// SPDX-License-Identifier: Apache-2.0
#include "bench/suite.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/yaml.h"

namespace fringeslam::bench {

namespace fs = std::filesystem;

Suite read_suite(const fs::path& folder, const std::string& name) {
  const fs::path file = folder / (name + ".yaml");
  if (!fs::exists(file)) {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().stem().string());
    std::sort(names.begin(), names.end());
    std::string list;
    for (const std::string& known : names) list += (list.empty() ? "" : ", ") + known;
    throw Error("no suite '" + name + "'; available: " + list);
  }
  const YamlMap map = YamlMap::load(file);
  Suite suite;
  suite.quick = map.boolean_or("quick", false);
  suite.rows = map.texts("rows");
  map.finish();
  return suite;
}

bool selects(const std::string& wanted, const std::string& id) {
  return id == wanted ||
         (id.size() > wanted.size() && id.compare(0, wanted.size(), wanted) == 0 && id[wanted.size()] == '.');
}

std::vector<std::string> ids_without_row(const std::vector<std::string>& ids, const std::vector<Row>& rows) {
  std::vector<std::string> without;
  std::copy_if(ids.begin(), ids.end(), std::back_inserter(without), [&](const std::string& id) {
    return std::none_of(rows.begin(), rows.end(), [&](const Row& row) { return selects(id, row.id); });
  });
  return without;
}

nlohmann::ordered_json to_json(const Row& row) {
  nlohmann::ordered_json json = {{"id", row.id},
                                 {"value", row.value},
                                 {"unit", row.unit},
                                 {"n", row.n},
                                 {"interval_95", {row.interval_low, row.interval_high}},
                                 {"limit", row.limit},
                                 {"limit_is", row.direction == Limit::most ? "most" : "least"},
                                 {"pass", row.pass}};
  if (row.yardstick > 0) {
    json["yardstick"] = row.yardstick;
    json["scaled"] = row.scaled;
  }
  return json;
}

std::vector<Row> read_baseline(const fs::path& file) {
  if (!fs::is_regular_file(file)) throw Error(file.string() + ": does not exist; write one by --json " + file.string());
  const auto json = nlohmann::json::parse(read_bytes(file), nullptr, false);
  std::vector<Row> rows;
  // JSON has no NaN, the value of a row that had nothing to compare.
  const auto number = [](const nlohmann::json& value) { return value.is_null() ? NAN : value.get<double>(); };
  try {
    for (const auto& entry : json) {
      Row row;
      row.id = entry.at("id");
      row.value = number(entry.at("value"));
      row.n = entry.at("n");
      row.interval_low = number(entry.at("interval_95").at(0));
      row.interval_high = number(entry.at("interval_95").at(1));
      if (entry.contains("yardstick")) {
        row.yardstick = entry.at("yardstick");
        row.scaled = entry.at("scaled");
      }
      rows.push_back(row);
    }
  } catch (const nlohmann::json::exception&) {
    rows.clear();
  }
  if (rows.empty()) throw Error(file.string() + ":1: contains no rows of an earlier --json");
  return rows;
}

bool is_worse(const Row& now, const Row& before) {
  const auto spread = [](const Row& row) { return row.interval_high > row.interval_low; };
  if (!spread(now) || !spread(before)) return false;
  // Rows that depend on the machine are compared by the values that they would have at a yardstick of 1.
  const auto factor = [](const Row& row) { return row.yardstick > 0 && row.value != 0 ? row.scaled / row.value : 1; };
  return now.direction == Limit::most ? factor(now) * now.interval_low > factor(before) * before.interval_high
                                      : factor(now) * now.interval_high < factor(before) * before.interval_low;
}

}  // namespace fringeslam::bench

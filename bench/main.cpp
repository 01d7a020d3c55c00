// SPDX-License-Identifier: Apache-2.0
// Prints the rows of the benchmark: id, value, n, 95 % interval, limit, verdict. Exit status: 0 if all rows pass, 1 if
// one fails, 2 if the measurement could not run or a row of --only could not be measured.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "bench/row.h"
#include "bench/suite.h"
#include "bench/yardstick.h"
#include "core/base/malloc_config.h"
#include "core/base/opencv_config.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam::bench {
namespace {

bool selected(const std::vector<std::string>& only, const std::string& id) {
  return only.empty() || std::any_of(only.begin(), only.end(), [&](const auto& wanted) { return selects(wanted, id); });
}

void check_names(const std::vector<std::string>& only, const std::vector<Item>& items) {
  std::vector<std::string> ids;
  for (const Item& item : items) ids.insert(ids.end(), item.ids.begin(), item.ids.end());
  for (const std::string& wanted : only) {
    if (std::any_of(ids.begin(), ids.end(), [&](const std::string& id) { return selects(wanted, id); })) continue;
    const std::string nearest = nearest_name(wanted, ids);
    throw Error("no row '" + wanted + "'" + (nearest.empty() ? "; see --list" : "; did you mean '" + nearest + "'?"));
  }
}

void print(const Row& row) {
  char interval[64], value[64];
  std::snprintf(value, sizeof value, "%.5g %s", row.value, row.unit.c_str());
  std::snprintf(interval, sizeof interval, "[%.5g, %.5g]", row.interval_low, row.interval_high);
  std::printf("%-28s %-16s n=%-6d %-26s limit %s %-10.5g %s", row.id.c_str(), value, row.n, interval,
              row.direction == Limit::most ? "<=" : ">=", row.limit, row.pass ? "pass" : "FAIL");
  if (row.yardstick > 0) std::printf("  (%.5g at yardstick 1; here %.2f)", row.scaled, row.yardstick);
  std::printf("\n");
  std::fflush(stdout);
}

// Reports the rows that are significantly worse than the baseline and returns their number.
int compare(const std::vector<Row>& rows, const std::vector<Row>& baseline) {
  int worse = 0;
  for (const Row& row : rows) {
    const auto before =
        std::find_if(baseline.begin(), baseline.end(), [&](const Row& known) { return known.id == row.id; });
    if (before == baseline.end() || !is_worse(row, *before)) continue;
    ++worse;
    std::fprintf(stderr, "%s is worse:  %.5g [%.5g, %.5g], was %.5g [%.5g, %.5g]\n", row.id.c_str(), row.value,
                 row.interval_low, row.interval_high, before->value, before->interval_low, before->interval_high);
  }
  return worse;
}

// Measures the rows of an item; those that depend on the machine are compared with their limits by the yardstick before and
// after them.
std::vector<Row> measured(const Item& item, const Context& context) {
  const bool speed = std::any_of(item.ids.begin(), item.ids.end(), [](const auto& id) { return selects("speed", id); });
  const double before = speed ? measure_yardstick() : 1;
  std::vector<Row> rows = item.run(context);
  if (!std::any_of(rows.begin(), rows.end(), depends_on_machine)) return rows;
  const double yardstick = std::sqrt(before * measure_yardstick());
  for (Row& row : rows) {
    if (depends_on_machine(row)) scale(row, yardstick);
  }
  return rows;
}

// `must_measure`: rows that cannot be measured here make the run fail, instead of being skipped.
int run(const std::vector<std::string>& only, bool must_measure, const std::string& json_file, const Context& context,
        const std::vector<Item>& items, const std::vector<Row>& baseline) {
  check_names(only, items);
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  std::vector<Row> rows;
  std::vector<std::string> chosen;
  const bool table = json_file != "-";
  bool all_pass = true;
  for (const Item& item : items) {
    if (only.empty() && item.on_request) continue;
    if (std::none_of(item.ids.begin(), item.ids.end(), [&](const auto& id) { return selected(only, id); })) continue;
    std::fprintf(stderr, "measuring %s\n", item.what.c_str());
    std::copy_if(item.ids.begin(), item.ids.end(), std::back_inserter(chosen),
                 [&](const std::string& id) { return selected(only, id); });
    for (Row row : measured(item, context)) {
      if (!selected(only, row.id)) continue;
      if (table) print(row);
      json.push_back(to_json(row));
      rows.push_back(row);
      all_pass &= row.pass;
    }
  }
  if (json_file == "-")
    std::printf("%s\n", json_text(json, 2).c_str());
  else if (!json_file.empty())
    write_text(json_file, json_text(json, 2) + "\n");
  const std::vector<std::string> missing = ids_without_row(chosen, rows);
  for (const std::string& id : missing) std::fprintf(stderr, "%s was not measured\n", id.c_str());
  const int worse = compare(rows, baseline);
  if (must_measure && !missing.empty()) return 2;
  return worse == 0 && all_pass ? 0 : 1;
}

}  // namespace
}  // namespace fringeslam::bench

int main(int argc, char** argv) {
  using namespace fringeslam::bench;
  fringeslam::keep_freed_memory();
  fringeslam::use_portable_opencv();
  CLI::App app{"FringeSLAM benchmarks: accuracy against exact ground truth, speed against peers"};
  std::vector<std::string> only;
  std::string json_file;
  Context context;
  bool list = false;
  std::string suite, baseline;
  app.add_option("--only", only, "Rows to measure; an id also selects all ids that continue it after a dot")
      ->delimiter(',');
  app.add_option("--json", json_file, "Write the rows as JSON to this file (- for standard output)");
  app.add_flag("--quick", context.quick, "Fewer samples: a rough estimate");
  app.add_option("--minutes", context.minutes,
                 "Stop rows over random motions after this time; their n is what they reached")
      ->check(CLI::Range(0.01, 1e5));
  // CLI11 takes numbers with a leading zero for octal.
  const auto decimal = [](std::string& text) {
    int number = 0;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (failure != std::errc() || end != text.data() + text.size()) return "'" + text + "' is not a whole number";
    text = std::to_string(number);
    return std::string();
  };
  std::vector<int> cases;
  app.add_option("--cases", cases, "First and last case of rows over random motions, to divide them among processes")
      ->expected(2)
      ->transform(CLI::Validator(decimal, ""))
      ->check(CLI::Range(1, 1000000));
  app.add_flag("--list", list, "List all rows");
  app.add_option("--suite", suite, "The rows of bench/accuracy/suites/NAME.yaml: ci, full")->excludes("--only");
  app.add_option("--baseline", baseline, "Rows of an earlier --json FILE: fail if one is significantly worse");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    std::fprintf(stderr, "bench: %s; see --help\n", e.what());
    return 2;
  }
  if (!cases.empty()) {
    context.first_case = cases[0];
    context.last_case = cases[1];
  }
  try {
    std::vector<Item> items = accuracy_items();
    for (const auto& more :
         {sensor_items(),        prediction_items(),   unwrapping_items(),    calibration_items(),
          decoding_items(),      registration_items(), wrong_pose_items(),    registration_speed_items(),
          rendering_items(),     cycles_items(),       landmark_items(),      landmark_speed_items(),
          mapping_items(),       motion_items(),       mapping_speed_items(), frame_speed_items(),
          world_items(),         large_world_items(),  speed_items(),         capture_items(),
          study_items(),         soak_items(),         victim_items(),        moving_hand_items(),
          mission_items(),       real_capture_items(), image_pose_items(),    scale_items(),
          saving_items(),        core_items(),         megapixel_items(),     indirect_items(),
          dynamic_range_items(), dataset_items(),      load_items(),          hostile_items(),
          robust_items(),        same_bits_items(),    subsurface_items(),    scene_page_items(),
          code_items()})
      items.insert(items.end(), more.begin(), more.end());
#ifdef FRINGESLAM_PYTHON
    const std::vector<Item> python = python_items();
    items.insert(items.end(), python.begin(), python.end());
#endif
    if (list) {
      for (const Item& item : items) {
        for (const std::string& id : item.ids) std::printf("%s\n", id.c_str());
      }
      return 0;
    }
    if (!suite.empty()) {
      const Suite rows = read_suite(FRINGESLAM_SUITES, suite);
      only = rows.rows;
      context.quick |= rows.quick;
    }
    // A suite, as a run of all rows, skips captures that are not on this machine.
    const bool must_measure = suite.empty() && !only.empty();
    return run(only, must_measure, json_file, context, items,
               baseline.empty() ? std::vector<Row>() : read_baseline(baseline));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "bench: %s\n", e.what());
    return 2;
  }
}

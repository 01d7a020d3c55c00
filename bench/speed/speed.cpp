// SPDX-License-Identifier: Apache-2.0
// Speed rows.
#include <cstdio>

#include "bench/row.h"
#include "bench/script.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

// Runs a measuring script of this folder and returns the number that it prints: the seconds it took.
double script_seconds(const std::string& script, const std::string& argument) {
  const std::string command = std::string(FRINGESLAM_BENCH_SCRIPTS) + "/" + script + " " + argument;
  double seconds = 0;
  if (std::sscanf(output_of(command).c_str(), "%lf", &seconds) != 1)
    throw Error(script + " " + argument + " printed no result; see its message above");
  return seconds;
}

Row minutes_row(const std::string& id, double seconds, double limit_minutes) {
  Row row;
  row.id = id;
  row.value = row.interval_low = row.interval_high = seconds / 60;  // a single sample has no interval
  row.unit = "min";
  row.n = 1;
  row.limit = limit_minutes;
  row.pass = row.value <= limit_minutes;
  return row;
}

}  // namespace

std::vector<Item> speed_items() {
  return {{{"speed.start.build"},
           "build from scratch, no compiler cache",
           [](const Context&) {
             return std::vector<Row>{minutes_row("speed.start.build", script_seconds("start.sh", "build"), 5)};
           }},
          {{"speed.start.again"},
           "rebuild after a change of one source file of core",
           [](const Context&) {
             return std::vector<Row>{minutes_row("speed.start.again", script_seconds("start.sh", "again"), 0.25)};
           }},
          {{"speed.start.test"},
           "tools/test after tools/run, built and run, no compiler cache",
           [](const Context&) {
             return std::vector<Row>{minutes_row("speed.start.test", script_seconds("start.sh", "test"), 14)};
           }},
          {{"start.deb"},
           "bare Debian 12 with the packages at hand, to the first score",
           [](const Context&) {
             return std::vector<Row>{minutes_row("start.deb", script_seconds("start.sh", "deb"), 1.5)};
           }},
          {{"speed.start.bare"}, "bare Debian 12 to the first report: tools/run in a fresh system", [](const Context&) {
             return std::vector<Row>{minutes_row("speed.start.bare", script_seconds("start.sh", "bare"), 8)};
           }}};
}

}  // namespace fringeslam::bench

// SPDX-License-Identifier: Apache-2.0
// One row of the bench's table, and the items that print rows.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace fringeslam::bench {

enum class Limit { most, least };

struct Row {
  std::string id;
  double value = 0;
  std::string unit;
  int n = 0;                                   // samples behind the value
  double interval_low = 0, interval_high = 0;  // 95 %
  double limit = 0;
  Limit direction = Limit::most;
  bool pass = false;
};

struct Context {
  bool quick = false;  // fewer samples: a first impression, not the figure of record
};

// A measurement that prints one or more rows. It runs when --only selects any of its ids.
struct Item {
  std::vector<std::string> ids;
  std::string what;
  std::function<std::vector<Row>(const Context&)> run;
  bool on_request = false;  // only when --only names it: it installs something, or takes an hour
};

// The median with its 95 % bootstrap interval (2000 resamplings, fixed seed) against a limit.
Row median_row(const std::string& id, const std::vector<double>& values, const std::string& unit, double limit,
               Limit direction = Limit::most);

// One value, an extreme of n samples, which has no interval.
Row bound_row(const std::string& id, double value, int n, const std::string& unit, double limit, Limit direction);

std::vector<Item> accuracy_items();
std::vector<Item> calibration_items();
std::vector<Item> capture_items();
std::vector<Item> sensor_items();
std::vector<Item> decoding_items();
std::vector<Item> frame_speed_items();
std::vector<Item> landmark_items();
std::vector<Item> prediction_items();
std::vector<Item> landmark_speed_items();
std::vector<Item> cycles_items();
std::vector<Item> large_world_items();
std::vector<Item> mapping_items();
std::vector<Item> mapping_speed_items();
std::vector<Item> registration_items();
std::vector<Item> registration_speed_items();
std::vector<Item> rendering_items();
std::vector<Item> soak_items();
std::vector<Item> speed_items();
std::vector<Item> study_items();
std::vector<Item> unwrapping_items();
std::vector<Item> victim_items();
std::vector<Item> world_items();
std::vector<Item> wrong_pose_items();

}  // namespace fringeslam::bench

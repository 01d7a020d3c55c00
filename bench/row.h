// SPDX-License-Identifier: Apache-2.0
// A row of the benchmark table, and the items that produce rows.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace fringeslam::bench {

enum class Limit { most, least };

struct Row {
  std::string id;
  double value = 0;
  std::string unit;
  int n = 0;                                   // number of samples behind the value
  double interval_low = 0, interval_high = 0;  // 95 %
  double limit = 0;
  Limit direction = Limit::most;
  bool pass = false;
  // Rows that depend on the machine (bench/yardstick.h): the yardstick when they were measured, and the value with which
  // the limit is compared. 0: not such a row.
  double yardstick = 0, scaled = 0;
};

struct Context {
  bool quick = false;  // fewer samples: a rough estimate, not the published figure
  // Rows over random cases: stop after this time and report the cases so far (0: all cases), and the range of cases.
  double minutes = 0;
  int first_case = 1, last_case = std::numeric_limits<int>::max();
};

// A measurement that produces one or more rows. It runs if --only selects any of its ids.
struct Item {
  std::vector<std::string> ids;
  std::string what;
  std::function<std::vector<Row>(const Context&)> run;
  bool on_request = false;  // only if named by --only: it installs something or takes an hour
};

// Returns the median and its 95 % bootstrap interval (2000 resamples, fixed seed), compared with a limit.
Row median_row(const std::string& id, const std::vector<double>& values, const std::string& unit, double limit,
               Limit direction = Limit::most);

// Returns a single value, such as an extreme of n samples, without an interval.
Row bound_row(const std::string& id, double value, int n, const std::string& unit, double limit, Limit direction);

// Returns the number of wrong results among `judged`, of which none may be wrong; NaN, which fails, if none was judged.
Row wrong_row(const std::string& id, int wrong, int judged, const std::string& unit);

// Least and greatest value; NaN, which no limit accepts, if one is NaN or there are none.
double least_of(const std::vector<double>& values);
double greatest_of(const std::vector<double>& values);

std::vector<Item> accuracy_items();
std::vector<Item> calibration_items();
std::vector<Item> capture_items();
std::vector<Item> code_items();
std::vector<Item> saving_items();
std::vector<Item> scale_items();
std::vector<Item> scene_page_items();
std::vector<Item> sensor_items();
std::vector<Item> decoding_items();
std::vector<Item> dynamic_range_items();
std::vector<Item> frame_speed_items();
std::vector<Item> image_pose_items();
std::vector<Item> indirect_items();
std::vector<Item> landmark_items();
std::vector<Item> motion_items();
std::vector<Item> prediction_items();
std::vector<Item> python_items();  // if the Python package is built
std::vector<Item> landmark_speed_items();
std::vector<Item> core_items();
std::vector<Item> cycles_items();
std::vector<Item> large_world_items();
std::vector<Item> mapping_items();
std::vector<Item> megapixel_items();
std::vector<Item> mission_items();
std::vector<Item> mapping_speed_items();
std::vector<Item> moving_hand_items();
std::vector<Item> real_capture_items();
std::vector<Item> registration_items();
std::vector<Item> registration_speed_items();
std::vector<Item> rendering_items();
std::vector<Item> hostile_items();
std::vector<Item> robust_items();
std::vector<Item> same_bits_items();
std::vector<Item> soak_items();
std::vector<Item> speed_items();
std::vector<Item> study_items();
std::vector<Item> subsurface_items();
std::vector<Item> dataset_items();
std::vector<Item> load_items();
std::vector<Item> unwrapping_items();
std::vector<Item> victim_items();
std::vector<Item> world_items();
std::vector<Item> wrong_pose_items();

}  // namespace fringeslam::bench

// SPDX-License-Identifier: Apache-2.0
#include "bench/row.h"

#include <algorithm>
#include <cmath>

#include "core/score/score.h"

namespace fringeslam::bench {

Row median_row(const std::string& id, const std::vector<double>& values, const std::string& unit, double limit,
               Limit direction) {
  const MedianInterval interval = median_interval_of(values);
  Row row;
  row.id = id;
  row.value = interval.median;
  row.unit = unit;
  row.n = static_cast<int>(values.size());
  row.interval_low = interval.low;
  row.interval_high = interval.high;
  row.limit = limit;
  row.direction = direction;
  row.pass = direction == Limit::most ? row.value <= limit : row.value >= limit;
  return row;
}

Row bound_row(const std::string& id, double value, int n, const std::string& unit, double limit, Limit direction) {
  Row row = median_row(id, {value}, unit, limit, direction);
  row.n = n;
  return row;
}

Row wrong_row(const std::string& id, int wrong, int judged, const std::string& unit) {
  return bound_row(id, judged > 0 ? static_cast<double>(wrong) : NAN, judged, unit, 0, Limit::most);
}

double least_of(const std::vector<double>& values) {
  const bool known =
      !values.empty() && std::none_of(values.begin(), values.end(), [](double v) { return std::isnan(v); });
  return known ? *std::min_element(values.begin(), values.end()) : NAN;
}

double greatest_of(const std::vector<double>& values) {
  std::vector<double> negated;
  for (const double value : values) negated.push_back(-value);
  return -least_of(negated);
}

}  // namespace fringeslam::bench

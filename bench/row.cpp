// SPDX-License-Identifier: Apache-2.0
#include "bench/row.h"

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

}  // namespace fringeslam::bench

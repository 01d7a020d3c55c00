// SPDX-License-Identifier: Apache-2.0
// How options describe themselves. An options struct has a default on each field and one
//
//   template <class Visitor> void describe(Visitor& v) {
//     v.field("max_range_m", max_range_m, {0.1, 10}, "farthest depth that is kept");
//   }
//
// The YAML reader, `--set`, the recorded config.yaml and check_options() are visitors of it, so a
// name, a default, a range and a help text are each written once.
#pragma once

#include <string>
#include <vector>

#include "core/types/error.h"

namespace fringeslam {

// Closed interval of permitted values; NaN is never inside.
struct Range {
  double low = 0, high = 0;
  bool contains(double value) const { return value >= low && value <= high; }
};

// "3" for 3, "0.05" for 0.05: the shortest text that reads back as the same double.
std::string to_text(double value);

std::string range_error(const std::string& name, double value, const Range& range);

// The known name nearest to `unknown` by edit distance, or empty when none is near.
std::string nearest_name(const std::string& unknown, const std::vector<std::string>& known);

// Throws Error naming the field when a value is out of its range.
class RangeChecker {
 public:
  explicit RangeChecker(std::string prefix) : prefix_(std::move(prefix)) {}
  void field(const char* name, const double& value, Range range, const char*) { require(name, value, range); }
  void field(const char* name, const int& value, Range range, const char*) { require(name, value, range); }
  void field(const char*, const bool&, const char*) {}
  void field(const char* name, const std::string& value, const std::vector<std::string>& choices, const char*);

 private:
  void require(const char* name, double value, Range range) const {
    if (!range.contains(value)) throw Error(range_error(prefix_ + "." + name, value, range));
  }
  std::string prefix_;
};

template <class Options>
void check_options(const Options& options, const std::string& prefix) {
  RangeChecker checker(prefix);
  // describe() is shared with writers; the checker only reads.
  const_cast<Options&>(options).describe(checker);
}

}  // namespace fringeslam

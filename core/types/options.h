// SPDX-License-Identifier: Apache-2.0
// Self-describing options. An options struct has default member values and one method
//
//   template <class Visitor> void describe(Visitor& v) {
//     v.field("max_range_m", max_range_m, {0.1, 10}, "maximum depth");
//   }
//
// The YAML reader, `--set`, the recorded config.yaml and check_options() are visitors of describe(), so each name,
// default, range and help text is written once.
#pragma once

#include <string>
#include <vector>

#include "core/types/error.h"

namespace fringeslam {

// Closed interval of permitted values; NaN is always outside.
struct Range {
  double low = 0, high = 0;
  bool contains(double value) const { return value >= low && value <= high; }
};

// Formats a number as the shortest text that reads back as the same double, such as "3" or "0.05".
std::string to_text(double value);

std::string range_error(const std::string& name, double value, const Range& range);

// Returns the known name closest to `unknown` by edit distance, or an empty string if none is close.
std::string nearest_name(const std::string& unknown, const std::vector<std::string>& known);

// Visitor that throws Error naming the first field whose value is out of range.
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
  // describe() takes non-const fields because readers modify them; RangeChecker does not.
  const_cast<Options&>(options).describe(checker);
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Self-describing options. An options struct has default member values and one method
//
//   template <class Visitor> void describe(Visitor& v) {
//     v.field("max_range_m", max_range_m, {0.1, 10}, "maximum depth");
//     v.field("background", background, "what counts as background");
//   }
//
// The YAML reader, `--set`, the recorded config.yaml and check_options() are visitors of describe(), so each name,
// default, range and help text is written once. The choices of an enum field are named beside the enum:
//
//   enum class Background { plane, none };
//   constexpr auto choices(Background) {
//     return std::to_array<Choice<Background>>({{Background::plane, "plane"}, {Background::none, "none"}});
//   }
#pragma once

#include <array>
#include <concepts>
#include <string>
#include <type_traits>
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

// A value of an enum and its name in YAML, help and reports.
template <class E>
struct Choice {
  E value;
  const char* name;
};

// An enum whose choices(E), found by argument-dependent lookup, returns an array of Choice<E> in the order listed to
// users.
template <class E>
concept NamedEnum = std::is_enum_v<E> && requires(E value) {
  { choices(value)[0].value } -> std::convertible_to<E>;
  { choices(value)[0].name } -> std::convertible_to<const char*>;
};

// Returns the name of a value; "" for a value that is not among the choices.
template <NamedEnum E>
constexpr const char* to_string(E value) {
  for (const Choice<E>& choice : choices(value)) {
    if (choice.value == value) return choice.name;
  }
  return "";
}

template <NamedEnum E>
std::vector<E> choice_values() {
  std::vector<E> values;
  for (const Choice<E>& choice : choices(E())) values.push_back(choice.value);
  return values;
}

template <NamedEnum E>
std::vector<std::string> choice_names() {
  std::vector<std::string> names;
  for (const Choice<E>& choice : choices(E())) names.emplace_back(choice.name);
  return names;
}

// Visitor that throws Error naming the first field whose value is out of range.
class RangeChecker {
 public:
  explicit RangeChecker(std::string prefix) : prefix_(std::move(prefix)) {}
  void field(const char* name, const double& value, Range range, const char*) { require(name, value, range); }
  void field(const char* name, const int& value, Range range, const char*) { require(name, value, range); }
  void field(const char*, const bool&, const char*) {}
  template <NamedEnum E>
  void field(const char*, const E&, const char*) {}

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

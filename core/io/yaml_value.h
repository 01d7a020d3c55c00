// SPDX-License-Identifier: Apache-2.0
// A value of a YAML file as it was read (core/io/yaml.h).
#pragma once

#include <optional>
#include <string>

#include "core/types/options.h"

namespace fringeslam {

// A number that was read, or anything drawn from a distribution.
struct YamlValue {
  std::string path;            // as for YamlMap::set()
  std::string text;            // the value; drawn if there is a distribution
  std::string distribution;    // as given; empty: the file gives the value
  std::string place;           // file:line; without the line if it is unknown
  std::optional<Range> range;  // of numbers
  bool whole = false;          // must be a whole number
};

}  // namespace fringeslam

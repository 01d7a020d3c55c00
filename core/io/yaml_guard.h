// SPDX-License-Identifier: Apache-2.0
// What a YAML file may not hold, found in one pass over it before anything is built from it.
#pragma once

#include <cstddef>
#include <string>

namespace fringeslam {

// The largest file that is read. What it may hold in all, maps within maps and keys of one map are limited likewise:
// no file that somebody wrote comes near, and one that does would take all of the memory, or hours.
constexpr size_t kMostYamlBytes = 16 << 20;

// Throws Error with name:line, or what yaml-cpp throws where the text is no YAML. A second document, anchors and
// aliases are refused: one would be left out without a word, and what is drawn from a distribution depends on its
// place in the file, of which a node with an alias has two.
void check_yaml(const std::string& text, const std::string& name);

}  // namespace fringeslam

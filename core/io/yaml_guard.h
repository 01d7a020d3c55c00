// SPDX-License-Identifier: Apache-2.0
// Checks limits and unsupported features of YAML text in one pass, before a document is built from it.
#pragma once

#include <cstddef>
#include <string>

namespace fringeslam {

// Maximum file size. The number of values, the nesting depth and the number of keys per map are limited as well: no
// hand-written file comes close, and a file beyond the limits could exhaust memory or take hours.
constexpr size_t kMostYamlBytes = 16 << 20;
constexpr size_t kDeepestYaml = 64;  // nested maps and lists

// Throws Error with name:line, or a yaml-cpp exception if the text is not valid YAML. A second document is rejected
// because it would be silently ignored; anchors and aliases are rejected because random draws depend on the position in
// the file, which is ambiguous for an aliased node.
void check_yaml(const std::string& text, const std::string& name);

}  // namespace fringeslam

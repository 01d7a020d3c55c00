// SPDX-License-Identifier: Apache-2.0
// Names of image files in import.yaml: numbered names, natural order, files beside the YAML file or the images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/io/yaml.h"

namespace fringeslam {

// True for one name with a number field, such as "img_{:02d}.png" or "img_%02d.png".
bool is_numbered(const std::vector<std::string>& names);

// Formats such a name with a number. Throws Error about `key` if it does not have exactly one number field.
std::string numbered(const YamlMap& map, const std::string& key, const std::string& format, int number);

// Natural order: "pose2" before "pose10".
bool natural_order_less(const std::string& a, const std::string& b);

// True for the extensions of image files.
bool is_image(const std::filesystem::path& file);

// Looks next to the YAML file and then in `folder`; empty if the path exists in neither.
std::filesystem::path beside(const YamlMap& map, const std::filesystem::path& folder, const std::string& name);

}  // namespace fringeslam

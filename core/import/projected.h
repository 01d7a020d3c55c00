// SPDX-License-Identifier: Apache-2.0
// `projected:` of import.yaml: images of what the projector showed, from which the patterns are recognized.
#pragma once

#include <filesystem>
#include <vector>

#include "core/io/yaml.h"
#include "core/patterns/recognition.h"

namespace fringeslam {

// Returns the images that the `projected` key of an entry names, in the entry's order: a file, a list, a name with a
// number field, counted from `projected_first` or `first` as far as files exist, or a folder. They are searched next to
// the YAML file and then in `folder`. Throws Error if one is missing.
std::vector<std::filesystem::path> projected_files(const YamlMap& entry, const std::filesystem::path& folder);

// Recognizes the pattern of a file. Throws Error about the entry if it shows none, or if its colour channels differ.
RecognizedPattern recognize_file(const YamlMap& entry, const std::filesystem::path& file, const cv::Size& projector);

}  // namespace fringeslam

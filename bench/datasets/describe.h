// SPDX-License-Identifier: Apache-2.0
// Documents of a dataset: its datasheet for readers, and its metadata for catalogs.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "bench/datasets/spec.h"

namespace fringeslam::datasets {

struct FileEntry {
  std::string name, sha256;
  uint64_t bytes = 0;
};

// Contents of a finished dataset.
struct Contents {
  std::string program_version;
  std::vector<FileEntry> tars;
  FileEntry index;
  std::array<int, kSplits.size()> samples = {}, worlds = {};
  int refused = 0;  // trials
  std::vector<std::string> scenes, rigs;
};

// Returns the datasheet in Markdown (Gebru et al., Datasheets for Datasets, 2021).
std::string datasheet(const Spec& spec, const Contents& contents);

// Returns the metadata in JSON-LD (Croissant 1.0).
nlohmann::ordered_json croissant(const Spec& spec, const Contents& contents);

}  // namespace fringeslam::datasets

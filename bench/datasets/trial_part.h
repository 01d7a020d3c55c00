// SPDX-License-Identifier: Apache-2.0
// The samples of one trial on disk, before its tar file is complete: a piece of the tar file and its index.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/datasets/spec.h"

namespace fringeslam::datasets {

struct PartSample {
  int sample = 0;
  uint64_t offset = 0, bytes = 0;  // of its members in the piece, or in the tar file
  std::string sha256;              // published
  uint32_t crc32 = 0;              // checked when the piece is joined; ten times as fast
};

struct TrialIndex {
  int trial = 0;
  std::string scene, rig;
  std::vector<PartSample> samples;
  std::string refused;  // why the simulator refused the trial, which then has no samples; empty: it did not
};

std::filesystem::path part_file(const std::filesystem::path& folder, int trial);
std::filesystem::path part_index_file(const std::filesystem::path& folder, int trial);

// Renders a trial and writes both files into `folder`, the index last: the piece is complete if the index exists. Memory
// does not grow with the number of views. A trial that the simulator refuses has an index only. Throws Error if a file
// cannot be written.
TrialIndex write_trial(const Spec& spec, const studies::Trial& trial, const std::filesystem::path& folder);

// Returns the index of a trial as one line of JSON.
std::string index_text(const TrialIndex& index);
// Parses the index of a trial; empty if it is none.
std::optional<TrialIndex> trial_index_of(const std::string& text);

// Reads the index of a trial; empty if there is none, or if it or the piece is damaged.
std::optional<TrialIndex> read_trial(const std::filesystem::path& folder, int trial);

}  // namespace fringeslam::datasets

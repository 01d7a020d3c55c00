// SPDX-License-Identifier: Apache-2.0
// The folder of a dataset.
//
//   dataset.json            format, identity of the specification, number of samples and splits
//   dataset.yaml            the specification
//   train-000000.tar …      samples; each tar file holds whole trials of one split
//   index.csv               for each sample its split, world, drawn values, and its place: tar file, offset, bytes, sha256
//   refused.csv             trials without samples, if any
//   README.md               datasheet
//   croissant.json          metadata for catalogs (http://mlcommons.org/croissant/1.0)
//   SHA256SUMS              of all files above; written last: it marks a complete dataset
//   parts/                  until then: finished trials and the indices of finished tar files
//
// All files except those below parts/ appear only when complete. A process may be killed at any time and started again,
// and several processes may work on the same folder, even on the same tar file: they write the same bytes.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "bench/datasets/describe.h"
#include "bench/datasets/spec.h"

namespace fringeslam::datasets {

constexpr const char* kFormat = "fringeslam-samples-1";
// Subfolder of unfinished parts.
constexpr const char* kParts = "parts";

class DatasetFolder {
 public:
  // Creates the folder if there is none. Throws Error if it contains another dataset, or one of another version of the
  // program.
  DatasetFolder(std::filesystem::path folder, const Spec& spec, const std::string& identity,
                const std::string& program_version);

  const std::vector<Tar>& tars() const { return tars_; }
  // Folder in which write_trial() puts the trials of a tar file.
  std::filesystem::path parts_of(size_t tar) const;
  bool has(size_t tar) const;
  // Returns the trials of an unfinished tar file that are yet to be rendered.
  std::vector<int> missing(size_t tar) const;
  // Joins the trials of a tar file and removes the pieces. Throws Error if a piece is damaged, after removing it.
  void join(size_t tar) const;

  bool complete() const;
  // Writes index, datasheet, metadata and checksums if all tar files exist; returns false if some are missing.
  bool finish() const;
  // Returns what the index of a dataset lists, with the sizes of the tar files but without their checksums. Throws Error if the
  // index is missing or damaged.
  Contents contents() const;

 private:
  // Writes a file in parts/ and moves it to its place.
  void place(const std::string& name, const std::string& text) const;
  // Writes the index; returns the tar files.
  std::vector<FileEntry> write_index() const;
  // Returns the tar files of a complete dataset with the checksums in SHA256SUMS. Throws Error if the index differs from its
  // checksum, or the size of a tar file from that in the index.
  std::vector<FileEntry> recorded_tars(const Contents& found) const;
  std::filesystem::path tar_file(size_t tar) const;
  std::filesystem::path index_of(size_t tar) const;

  std::filesystem::path folder_;
  const Spec& spec_;
  std::string version_;
  std::vector<Tar> tars_;
};

}  // namespace fringeslam::datasets

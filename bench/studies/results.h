// SPDX-License-Identifier: Apache-2.0
// The result lines of trials, on disk.
//
// Shard I of N contains the trials whose number modulo N is I. While it runs, each result is appended to
// shards/I-of-N.HOST.PID.partial; when all are complete they are written in order to shards/I-of-N.jsonl. After a kill
// at any time, the appended results are read back; and since a trial's line is a function of the study and the trial's
// number, two processes working on the same shard do no harm.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "bench/studies/study.h"

namespace fringeslam::studies {

struct Shard {
  int index = 0, count = 1;
};
// Parses a shard such as "2/8". Throws Error.
Shard shard_of(const std::string& text);

class ShardFile {
 public:
  // Reads the results of earlier attempts. Throws Error if they are of another study.
  ShardFile(std::filesystem::path folder, const Study& study, Shard shard);
  ~ShardFile();
  ShardFile(const ShardFile&) = delete;
  ShardFile& operator=(const ShardFile&) = delete;

  const std::map<int, std::string>& lines() const { return lines_; }  // by trial
  std::vector<int> missing() const;
  // Appends a line. Throws Error if it cannot be written; a partly written line does not count.
  void add(int trial, const std::string& line);
  // Called when all trials are complete: replaces the partial files by the shard's file.
  void finish();

 private:
  std::filesystem::path folder_, partial_;
  const Study& study_;
  Shard shard_;
  std::map<int, std::string> lines_;
  int file_ = -1;
};

// Reads all shards in `folder`, whatever their number, finished or not. Throws Error if two lines of a trial differ, or
// if one is of another study.
std::map<int, std::string> merged_lines(const std::filesystem::path& folder, const Study& study);

}  // namespace fringeslam::studies

// SPDX-License-Identifier: Apache-2.0
// The lines of trials' results, on disk.
//
// A shard I of N has the trials whose numbers leave the rest I when divided by N. While it runs, each result is
// appended to shards/I-of-N.HOST.PID.partial as it comes; when all are there they are written in order to
// shards/I-of-N.jsonl. Whatever is killed when, what was appended is found again; and as a trial's line is a function
// of the study and its number, two processes that do the same shard at the same time do no harm.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "bench/studies/study.h"

namespace fringeslam::studies {

struct Shard {
  int index = 0, count = 1;
};
// "2/8". Throws Error.
Shard shard_of(const std::string& text);

class ShardFile {
 public:
  // Reads what earlier attempts left. Throws Error when that is of another study.
  ShardFile(std::filesystem::path folder, const Study& study, Shard shard);
  ~ShardFile();
  ShardFile(const ShardFile&) = delete;
  ShardFile& operator=(const ShardFile&) = delete;

  const std::map<int, std::string>& lines() const { return lines_; }  // by trial
  std::vector<int> missing() const;
  // Throws Error when it cannot be written; then nothing of it counts.
  void add(int trial, const std::string& line);
  // All trials are there: the shard's file, instead of what was appended.
  void finish();

 private:
  std::filesystem::path folder_, partial_;
  const Study& study_;
  Shard shard_;
  std::map<int, std::string> lines_;
  int file_ = -1;
};

// Of all shards in `folder`, whatever their count, finished or not. Throws Error when two lines of one trial differ, or
// when one is of another study.
std::map<int, std::string> merged_lines(const std::filesystem::path& folder, const Study& study);

}  // namespace fringeslam::studies

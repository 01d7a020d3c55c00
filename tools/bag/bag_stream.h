// SPDX-License-Identifier: Apache-2.0
// Reads a ROS bag in a child process with limits of time and memory, because broken files can make the bag library crash
// or exhaust the memory.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/bag/bag.h"

namespace fringeslam::tools {

class BagStream {
 public:
  // Opens a bag to read the messages of `topics`; none: only the list of its topics. Throws Error naming the file if it
  // is not a readable bag.
  BagStream(std::filesystem::path file, const std::vector<std::string>& topics);
  ~BagStream();
  BagStream(const BagStream&) = delete;
  BagStream& operator=(const BagStream&) = delete;

  // All topics of the bag.
  const std::vector<BagTopic>& topics() const { return topics_; }
  // Returns the next message in order of recording times; empty at the end. Throws Error naming the file if it is
  // damaged.
  std::optional<BagMessage> next();

 private:
  std::string record(char& kind);
  void read(char* bytes, size_t size);
  [[noreturn]] void report_death();
  void stop();
  // Kills the child unless it has ended; returns its status once, then 0.
  int end_child();

  std::filesystem::path file_;
  std::vector<BagTopic> topics_;
  int pipe_ = -1;
  pid_t child_ = -1;
  bool ended_ = false;
};

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "bench/process_memory.h"

#include <fstream>

#include "core/types/error.h"

namespace fringeslam::bench {

double process_memory_mib(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(key + ":")) return std::stod(line.substr(key.size() + 1)) / 1024;
  }
  throw Error("/proc/self/status has no " + key);
}

}  // namespace fringeslam::bench

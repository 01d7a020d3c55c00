// SPDX-License-Identifier: Apache-2.0
#include "bench/script.h"

#include <cstdio>
#include <memory>

namespace fringeslam::bench {

std::string output_of(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), &pclose);
  std::string text(1 << 16, '\0');
  text.resize(pipe ? std::fread(text.data(), 1, text.size(), pipe.get()) : 0);
  return text;
}

}  // namespace fringeslam::bench

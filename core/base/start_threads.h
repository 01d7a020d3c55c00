// SPDX-License-Identifier: Apache-2.0
// Starts several threads or none.
#pragma once

#include <functional>
#include <thread>
#include <vector>

namespace fringeslam {

// Starts one thread for each function. If a thread cannot be started, calls `stop`, which must make the functions return, joins the
// threads that run, and throws std::system_error.
inline std::vector<std::thread> start_threads(const std::vector<std::function<void()>>& functions,
                                              const std::function<void()>& stop) {
  std::vector<std::thread> threads;
  threads.reserve(functions.size());
  try {
    for (const std::function<void()>& function : functions) threads.emplace_back(function);
  } catch (...) {
    stop();
    for (std::thread& thread : threads) thread.join();
    throw;
  }
  return threads;
}

}  // namespace fringeslam

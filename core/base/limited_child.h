// SPDX-License-Identifier: Apache-2.0
// A child process for libraries that broken files can make crash, hang or allocate without bound.
#pragma once

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdio>

namespace fringeslam {

// Call it first in the child of a fork. From then on, the process runs for at most `time_limit_s` seconds of processor
// time, allocates at most `memory_limit_gib` more memory, and neither runs the parent's signal handlers nor uses its
// terminal.
inline void enter_limited_child(double time_limit_s, double memory_limit_gib) {
  for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM}) std::signal(signal, SIG_DFL);
  const int nowhere = open("/dev/null", O_RDWR);
  for (const int standard : {0, 1, 2}) dup2(nowhere, standard);
  const auto seconds = static_cast<rlim_t>(std::ceil(time_limit_s));
  const rlimit time{seconds, seconds};
  setrlimit(RLIMIT_CPU, &time);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
#ifdef __SANITIZE_ADDRESS__  // its shadow memory exceeds any limit
  (void)memory_limit_gib;
#else
  long pages = 0;
  if (FILE* statm = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(statm, "%ld", &pages) != 1) pages = 0;
    std::fclose(statm);
  }
  const auto bytes = static_cast<rlim_t>(pages) * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) +
                     static_cast<rlim_t>(memory_limit_gib * 1024 * 1024 * 1024);
  const rlimit memory{bytes, bytes};
  setrlimit(RLIMIT_AS, &memory);
#endif
}

// Writes all bytes to a descriptor; returns false if the other end is closed.
inline bool write_all(int descriptor, const char* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    const ssize_t written = ::write(descriptor, bytes + done, size - done);
    if (written <= 0) return false;
    done += static_cast<size_t>(written);
  }
  return true;
}

}  // namespace fringeslam

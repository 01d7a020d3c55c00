// SPDX-License-Identifier: Apache-2.0
// A child process for libraries that broken files can make crash, hang or allocate without bound.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace fringeslam {

// Call it first in the child of a fork. From then on, the process runs for at most `time_limit_s` seconds of processor
// time, allocates at most `memory_limit_gib` more memory, and neither runs the parent's signal handlers nor uses its
// terminal.
void enter_limited_child(double time_limit_s, double memory_limit_gib);

// The part of enter_limited_child() about signal handlers, terminal and core files.
void detach_child();

// Closes all descriptors of a child except 0 to 2 and this one, and returns its new number, 3. Ends the process if that fails.
int keep_only_descriptor(int descriptor);

// Returns the address space of this process, and limits it; only the first limit can be raised again, up to the second.
uint64_t address_space_bytes();
void limit_address_space(uint64_t bytes, uint64_t most_bytes);

enum class ChildReads { files, nothing };

// Takes away, as far as the kernel can, everything but reading, computing and writing to open descriptors: no file is
// written, emptied or removed, no process started or reached, no network. With ChildReads::files, files outside /dev, /proc
// and /sys, and in /dev/shm, can be opened for reading; with ChildReads::nothing, none.
void restrict_child(ChildReads reads);

struct ChildLimits {
  double time_s = 60, memory_gib = 4;
  ChildReads reads = ChildReads::nothing;
};

enum class ChildEnd { answered, too_slow, crashed, not_started };
struct ChildAnswer {
  ChildEnd end = ChildEnd::not_started;
  std::string bytes;  // if it answered; not empty
};

// Runs `work` in a restricted child process with these limits and returns its answer, which must not be empty. `work` must not
// throw, nor use descriptors that were open before. A child that takes longer than the time limit is killed.
ChildAnswer answer_of_child(const ChildLimits& limits, const std::function<std::string()>& work);

// Writes all bytes to a descriptor; returns false if the other end is closed.
bool write_all(int descriptor, const char* bytes, size_t size);

}  // namespace fringeslam

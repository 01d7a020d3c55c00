// SPDX-License-Identifier: Apache-2.0
#pragma once

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace fringeslam {

// For a program's start. Every view needs the same few hundred megabytes of images, which the C library would return to
// the system and ask for again each time: up to a fifth of the time of a depth map is the page faults of that.
inline void keep_freed_memory() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#pragma once

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace fringeslam {

// Configures glibc's malloc to keep freed memory instead of returning it to the system; call it at program start. Every
// view allocates the same few hundred megabytes of images, and page faults on fresh pages would otherwise take up to a
// fifth of the time of a depth map.
inline void keep_freed_memory() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

// Returns freed memory to the system, at the end of a phase that needed more than the next one.
inline void release_freed_memory() {
#if defined(__GLIBC__)
  malloc_trim(0);
#endif
}

}  // namespace fringeslam

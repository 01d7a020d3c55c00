// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace fringeslam::bench {

// Returns a size, in MiB, from /proc/self/status: VmRSS (resident), VmHWM (its peak) or RssAnon (resident without pages of
// files). Throws Error if the kernel does not report it.
double process_memory_mib(const std::string& key);

}  // namespace fringeslam::bench

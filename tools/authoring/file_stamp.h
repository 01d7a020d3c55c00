// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace fringeslam::tools {

// Changes with every change of a file: times of modification and of the last change, ns, size and inode. Empty if there is no
// such file.
using FileStamp = std::optional<std::vector<int64_t>>;

inline int64_t nanoseconds(const timespec& time) { return int64_t{1'000'000'000} * time.tv_sec + time.tv_nsec; }

inline FileStamp file_stamp(const std::filesystem::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return std::nullopt;
  return std::vector<int64_t>{nanoseconds(status.st_mtim), nanoseconds(status.st_ctim), status.st_size,
                              static_cast<int64_t>(status.st_ino)};
}

}  // namespace fringeslam::tools

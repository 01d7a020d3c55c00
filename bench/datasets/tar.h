// SPDX-License-Identifier: Apache-2.0
// Members of a tar archive in POSIX ustar format. Headers depend on name and size only: owner 0, mode 0644 and a fixed
// time. Members can be concatenated; kTarEnd completes an archive.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace fringeslam::datasets {

constexpr size_t kTarBlock = 512;
// Two empty blocks end an archive.
constexpr size_t kTarEnd = 2 * kTarBlock;

// Returns a member: header, content, and zeros up to the next block. Throws Error for names longer than 100 bytes and
// contents of 8 GiB or more, which the format cannot represent.
std::string tar_member(const std::string& name, std::string_view content);

}  // namespace fringeslam::datasets

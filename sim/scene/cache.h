// SPDX-License-Identifier: Apache-2.0
// Content-addressed cache of files that are reproducible but expensive to compute. The file name is a hash of the
// input, so changed input uses a different file and entries never become stale.
//
// The folder is $FRINGESLAM_CACHE, else $XDG_CACHE_HOME/fringeslam, else ~/.cache/fringeslam, else `fringeslam` in the
// system's temporary folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringeslam::sim {

std::filesystem::path cache_folder();

// Returns the 64-bit FNV-1a hash of `content` as 16 hexadecimal digits.
std::string content_hash(const std::string& content);
// Returns the same of the contents of files in this order. Size and time stand for a file that cannot be read.
std::string contents_hash(const std::vector<std::filesystem::path>& files);

// Returns the path of the cached file `name`, writing `bytes` to it unless it already holds them. Throws Error if the
// file cannot be written.
std::filesystem::path cached_file(const std::string& name, const std::string& bytes);

// Returns the result stored for `content`, or nullopt if there is none. A stored file repeats its content, so hash
// collisions and truncated files count as misses.
std::optional<std::string> cached(const std::string& content);
// Stores `result` for `content`; returns false if it cannot be written, which only costs recomputation.
bool store(const std::string& content, const std::string& result);

}  // namespace fringeslam::sim

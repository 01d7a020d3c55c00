// SPDX-License-Identifier: Apache-2.0
// Files that can be made again at any time, kept because making them takes long, and named by the content from which
// they are made: a changed description has another name, so nothing in the cache is ever out of date.
//
// The folder is $FRINGESLAM_CACHE, else $XDG_CACHE_HOME/fringeslam, else ~/.cache/fringeslam.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace fringeslam::sim {

std::filesystem::path cache_folder();

// 16 hexadecimal digits (FNV-1a, 64 bits).
std::string content_hash(const std::string& content);

// The cached file of that name, made by `bytes` when there is none. Throws Error when it cannot be written.
std::filesystem::path cached_file(const std::string& name, const std::string& bytes);

// What was stored for a content. A stored file repeats its content, so that two contents of one hash, or a file cut
// off, are taken for absent.
std::optional<std::string> cached(const std::string& content);
// Not being able to store costs time, not correctness: returns false.
bool store(const std::string& content, const std::string& result);

}  // namespace fringeslam::sim

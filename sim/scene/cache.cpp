// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/cache.h"

#include <cstdlib>

#include "core/base/fnv.h"
#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/types/error.h"

namespace fringeslam::sim {

namespace fs = std::filesystem;

namespace {

// Returns false if the file cannot be written. Concurrent processes never see a part of it.
bool write_whole(const fs::path& file, const std::string& bytes) {
  std::error_code ignored;
  fs::create_directories(file.parent_path(), ignored);
  try {
    write_regular_file(file, bytes);
  } catch (const Error&) {
    return false;
  }
  return true;
}

fs::path file_of(const std::string& content) { return cache_folder() / "baked" / content_hash(content); }

// Formats a cache entry: content length, newline, content, result and hash of the result, which detects truncation.
std::string sealed(const std::string& content, const std::string& result) {
  return std::to_string(content.size()) + "\n" + content + result + content_hash(result);
}

std::string digits(uint64_t hash) {
  std::string text;
  for (int shift = 60; shift >= 0; shift -= 4) text += "0123456789abcdef"[hash >> shift & 15];
  return text;
}

// Describes a file that cannot be read, so that another one in its place differs.
std::string description_of_unreadable(const fs::path& file) {
  std::error_code none;
  if (!fs::exists(file, none)) return "missing";
  const uintmax_t bytes = fs::file_size(file, none);
  const auto written = fs::last_write_time(file, none).time_since_epoch().count();
  return "unreadable " + std::to_string(bytes) + " " + std::to_string(written);
}

}  // namespace

fs::path cache_folder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return value ? fs::path(value) : fs::path();
  };
  if (const fs::path own = variable("FRINGESLAM_CACHE"); !own.empty()) return own;
  if (const fs::path xdg = variable("XDG_CACHE_HOME"); !xdg.empty()) return xdg / "fringeslam";
  if (const fs::path home = variable("HOME"); !home.empty()) return home / ".cache" / "fringeslam";
  return fs::temp_directory_path() / "fringeslam";
}

std::string content_hash(const std::string& content) { return digits(fnv1a(content)); }

fs::path cached_file(const std::string& name, const std::string& bytes) {
  const fs::path file = cache_folder() / name;
  std::error_code ignored;
  if (fs::is_regular_file(file, ignored) && read_bytes(file) == bytes) return file;
  if (!write_whole(file, bytes))
    throw Error(file.string() + ": cannot be written; set FRINGESLAM_CACHE to a writable folder");
  return file;
}

std::optional<std::string> cached(const std::string& content) {
  std::string bytes;
  try {
    bytes = read_bytes(file_of(content));
  } catch (const Error&) {
    return std::nullopt;
  }
  const std::string head = sealed(content, "").substr(0, std::to_string(content.size()).size() + 1 + content.size());
  constexpr size_t kHash = 16;
  if (bytes.size() < head.size() + kHash || bytes.compare(0, head.size(), head) != 0) return std::nullopt;
  const std::string result = bytes.substr(head.size(), bytes.size() - head.size() - kHash);
  if (content_hash(result) != bytes.substr(bytes.size() - kHash)) return std::nullopt;
  return result;
}

bool store(const std::string& content, const std::string& result) {
  return write_whole(file_of(content), sealed(content, result));
}

std::string contents_hash(const std::vector<std::filesystem::path>& files) {
  std::string hashes;
  for (const std::filesystem::path& file : files) {
    try {
      hashes += digits(hash_input(file)) + "\n";
    } catch (const Error&) {
      hashes += description_of_unreadable(file) + "\n";
    }
  }
  return content_hash(hashes);
}

}  // namespace fringeslam::sim

// SPDX-License-Identifier: Apache-2.0
// Code shared by the fuzz targets.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <string_view>

#include "core/types/error.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace fringeslam::fuzz {

[[noreturn]] inline void fail(const std::string& what) {
  std::fprintf(stderr, "a finding of the fuzz target: %s\n", what.c_str());
  std::abort();
}

inline void require(bool holds, const std::string& what) {
  if (!holds) fail(what);
}

inline std::string text_of(const uint8_t* data, size_t size) { return {reinterpret_cast<const char*>(data), size}; }

// Returns a folder of this process, which is removed when it ends normally.
inline const std::filesystem::path& folder() {
  struct Folder {
    Folder() : path((std::filesystem::temp_directory_path() / "fringeslam-fuzz-XXXXXX").string()) {
      std::string name = path.string();
      if (!mkdtemp(name.data())) fail("no temporary folder " + name);
      path = name;
    }
    ~Folder() {
      std::error_code ignored;
      std::filesystem::remove_all(path, ignored);
    }
    std::filesystem::path path;
  };
  static const Folder only;
  return only.path;
}

inline void write(const std::filesystem::path& file, std::string_view bytes) {
  std::ofstream out(file, std::ios::binary);
  out << bytes;
  out.close();
  require(bool(out), file.string() + " cannot be written");
}

// Reads a file, which has to succeed or throw an Error of one line that begins with `where`, the file or its folder.
template <class Read>
bool read_or_refuse(const std::filesystem::path& where, const Read& read) {
  try {
    read();
    return true;
  } catch (const Error& error) {
    const std::string message = error.what();
    require(message.starts_with(where.string()), "a message that does not begin with the file: " + message);
    require(message.find('\n') == std::string::npos, "a message of several lines: " + message);
    return false;
  }
}

// A mutation of a YAML file for LLVMFuzzerCustomMutator: half of the time libFuzzer's own, which mostly breaks the syntax;
// otherwise replaces one value.
inline size_t mutate_yaml(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  static constexpr const char* kValues[] = {"0",
                                            "-0.0",
                                            "1",
                                            "-1",
                                            "3",
                                            "0.5",
                                            "1e-4",
                                            "1e-7",
                                            "100",
                                            "360",
                                            "1e4",
                                            "99999",
                                            "1e300",
                                            "-1e300",
                                            "4294967296",
                                            ".nan",
                                            ".inf",
                                            "true",
                                            "~",
                                            "''",
                                            "[]",
                                            "{}",
                                            "[0, 0, 0]",
                                            "[1, 1, 1]",
                                            "[1e-4, 100]",
                                            "[-1e4, 1e4, 0]",
                                            "{uniform: [0, 1]}",
                                            "{uniform: [1, 9]}",
                                            "{log_uniform: [1e-4, 100]}",
                                            "{normal: [0, 100]}",
                                            "{choice: [0, 1]}",
                                            "{choice: [plane, sphere]}",
                                            "{rotation_deg: [0, 0, {uniform: [-180, 180]}]}",
                                            "{translation_m: [1e4, 1e4, 1e4]}"};
  std::mt19937 random(seed);
  if (random() % 2 == 0 || size == 0) return LLVMFuzzerMutate(data, size, max_size);
  std::string text = text_of(data, size);
  const size_t before = text.find_first_of(":[,", random() % size);
  if (before == std::string::npos) return LLVMFuzzerMutate(data, size, max_size);
  const size_t begin = std::min(size, before + 1), end = std::min(size, text.find_first_of(",]}\n", begin));
  text.replace(begin, end - begin, std::string(" ") + kValues[random() % std::size(kValues)]);
  text.resize(std::min(text.size(), max_size));
  std::copy(text.begin(), text.end(), data);
  return text.size();
}

// For LLVMFuzzerInitialize: if the target was started as TARGET --seeds FOLDER, writes its seeds by `write_seeds` and ends.
template <class WriteSeeds>
int seeds_on_request(int argc, char** argv, const WriteSeeds& write_seeds) {
  if (argc != 3 || std::strcmp(argv[1], "--seeds") != 0) return 0;
  write_seeds(std::filesystem::path(argv[2]));
  std::exit(0);
}

}  // namespace fringeslam::fuzz

// SPDX-License-Identifier: Apache-2.0
// A temporary folder for each test, and simple file helpers.
#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>

#include "core/types/error.h"

namespace fringeslam::test {

namespace fs = std::filesystem;

class TempFolder {
 public:
  TempFolder() {
    std::string name = (fs::temp_directory_path() / "fringeslam-test-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder: " + name);
    path_ = name;
  }
  ~TempFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  const fs::path& path() const { return path_; }
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

inline std::string read_bytes(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  EXPECT_TRUE(in) << file << " cannot be read";
  std::stringstream content;
  content << in.rdbuf();
  return content.str();
}

inline void write_bytes(const fs::path& file, const std::string& bytes) {
  fs::create_directories(file.parent_path());
  std::ofstream out(file, std::ios::binary);
  out << bytes;
  out.close();
  ASSERT_TRUE(out) << file << " cannot be written";
}

// Truncates a file to the fraction `share`, as a full disk or a power loss would.
inline void truncate_file(const fs::path& file, double share) {
  fs::resize_file(file, static_cast<uintmax_t>(static_cast<double>(fs::file_size(file)) * share));
}

// Returns the relative names of all files and folders below `folder`.
inline std::set<std::string> listing(const fs::path& folder) {
  std::set<std::string> names;
  if (!fs::exists(folder)) return names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    names.insert(fs::relative(entry.path(), folder).string());
  return names;
}

// Returns the line of `text`, from 1, in which `part` first occurs; 0 if it does not occur.
inline int line_of(const std::string& text, const std::string& part) {
  const size_t place = text.find(part);
  if (place == std::string::npos) return 0;
  int line = 1;
  for (size_t i = 0; i < place; ++i) line += text[i] == '\n';
  return line;
}

// Returns `text` with the first `from` replaced; the test fails if there is none.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t place = text.find(from);
  EXPECT_NE(place, std::string::npos) << "'" << from << "' does not occur in the text";
  if (place != std::string::npos) text.replace(place, from.size(), to);
  return text;
}

// Returns the message of the Error that `action` throws; the test fails if none is thrown or if it has more than one
// line.
template <class Action>
std::string message_of(const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << "more than one line: " << error.what();
    return error.what();
  }
  ADD_FAILURE() << "no Error was thrown";
  return "";
}

}  // namespace fringeslam::test

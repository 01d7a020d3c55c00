// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_blocks.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <sstream>
#include <string>
#include <system_error>

#include "core/io/input_file.h"
#include "core/io/ply.h"
#include "core/types/error.h"

namespace fringeslam {

PlyBlocks::PlyBlocks(const std::filesystem::path& file)
    : path_(InputFile(file, kMostDataBytes).path()), stream_(file, std::ios::binary) {
  constexpr size_t kMostHeader = 4096;
  std::string header(kMostHeader, '\0');
  if (stream_) stream_.read(header.data(), static_cast<std::streamsize>(header.size()));
  if (!stream_ && stream_.gcount() == 0) throw Error(path_.string() + ": cannot be read");
  header.resize(static_cast<size_t>(stream_.gcount()));
  std::istringstream lines(header);
  // The header without its comments and numbers, which has to be that of PlyWriter.
  std::string line, layout;
  bool has_faces = false;
  while (std::getline(lines, line)) {
    const auto number_after = [&](const std::string& start) {
      uint64_t number = 0;
      const char* const end = line.data() + line.size();
      const auto [stop, error] = std::from_chars(line.data() + start.size(), end, number);
      if (error != std::errc() || stop != end) throw Error(path_.string() + ": invalid number in '" + line + "'");
      line = start + "0";
      return number;
    };
    if (line.starts_with("element vertex ")) vertices_ = number_after("element vertex ");
    if (line.starts_with("element face ")) triangles_ = number_after("element face "), has_faces = true;
    if (!line.starts_with("comment ")) layout += line + "\n";
    if (line == "end_header") break;
  }
  start_ = lines.tellg();
  PlyLayout expected{"", 0, true, true, std::nullopt};
  if (has_faces) expected.triangles = 0;
  std::string ours = ply_header(expected);
  const size_t comment = ours.find("comment ");
  ours.erase(comment, ours.find('\n', comment) + 1 - comment);
  if (!lines || layout != ours) throw Error(path_.string() + ": is not a map written by fringeslam run");
  stream_.clear();
  stream_.seekg(0, std::ios::end);
  const auto left = static_cast<uint64_t>(stream_.tellg() - start_);
  if (vertices_ > left / kVertex || triangles_ > (left - vertices_ * kVertex) / kTriangle)
    throw Error(path_.string() + ": the file is truncated");
}

void PlyBlocks::check_triangle(const char* bytes) const {
  std::array<uint32_t, 3> corners;
  std::memcpy(corners.data(), bytes + 1, sizeof corners);
  if (bytes[0] != 3 || std::any_of(corners.begin(), corners.end(), [&](uint32_t v) { return v >= vertices_; }))
    throw Error(path_.string() + ": is damaged: a triangle refers to a vertex that does not exist");
}

void PlyBlocks::read(uint64_t offset, std::vector<char>& block, size_t bytes) {
  stream_.clear();
  stream_.seekg(start_ + static_cast<std::streamoff>(offset));
  stream_.read(block.data(), static_cast<std::streamsize>(bytes));
  if (!stream_) throw Error(path_.string() + ": the file is truncated");
}

}  // namespace fringeslam

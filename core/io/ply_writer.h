// SPDX-License-Identifier: Apache-2.0
// Writes a PLY file of unknown length, part by part; the file is the same however it is divided into parts.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/io/ply.h"

namespace fringeslam {

// A file that is written from start to end. Small pieces are gathered, because a call of the C library for each takes longer
// than writing it. All members throw Error if the file cannot be written.
class OutputFile {
 public:
  explicit OutputFile(std::filesystem::path path);
  void write(const std::string& bytes) { write(bytes.data(), bytes.size()); }
  void write(const void* bytes, size_t size);
  // Replaces bytes at the start.
  void rewrite(const std::string& bytes);
  void close();
  const std::filesystem::path& path() const { return path_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  [[noreturn]] void fail() const;
  void put(const void* bytes, size_t size);
  void flush();
  std::filesystem::path path_;
  std::string gathered_;
  std::unique_ptr<std::FILE, Close> file_;
};

class PlyWriter {
 public:
  // `layout` describes the file but for its numbers of elements; triangles are written if it has any number of them. They
  // wait in a file beside `path`.
  PlyWriter(const std::filesystem::path& path, PlyLayout layout);
  ~PlyWriter();
  PlyWriter(const PlyWriter&) = delete;
  PlyWriter& operator=(const PlyWriter&) = delete;

  template <class Vertex>
  void add(const std::vector<Vertex>& vertices) {
    std::string bytes;
    for (const Vertex& vertex : vertices) append_ply_vertex(bytes, vertex);
    file_.write(bytes);
    layout_.vertices += vertices.size();
  }
  // Adds triangles of vertices, numbered in the order in which these were or will be added.
  void add(const std::vector<std::array<uint32_t, 3>>& triangles);
  // Completes the file.
  void finish();

  const PlyLayout& layout() const { return layout_; }

 private:
  std::string header() const;

  PlyLayout layout_;
  OutputFile file_;
  std::unique_ptr<OutputFile> faces_;
};

}  // namespace fringeslam

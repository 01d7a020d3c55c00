// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_writer.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "core/io/ply_blocks.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr size_t kHeader = 512;  // bytes reserved for the header, whose length depends on the numbers of elements

}  // namespace

OutputFile::OutputFile(fs::path path) : path_(std::move(path)), file_(std::fopen(path_.c_str(), "wb")) {
  if (!file_) fail();
}

void OutputFile::fail() const { throw Error(path_.string() + ": cannot be written: " + std::strerror(errno)); }

void OutputFile::write(const void* bytes, size_t size) {
  constexpr size_t kGathered = 1 << 20;
  if (gathered_.size() + size > kGathered) flush();
  if (size > kGathered)
    put(bytes, size);
  else
    gathered_.append(static_cast<const char*>(bytes), size);
}

void OutputFile::put(const void* bytes, size_t size) {
  if (size > 0 && std::fwrite(bytes, 1, size, file_.get()) != size) fail();
}

void OutputFile::flush() {
  put(gathered_.data(), gathered_.size());
  gathered_.clear();
}

void OutputFile::rewrite(const std::string& bytes) {
  flush();
  if (std::fseek(file_.get(), 0, SEEK_SET) != 0) fail();
  write(bytes);
}

void OutputFile::close() {
  flush();
  std::FILE* file = file_.release();
  if (file != nullptr && std::fclose(file) != 0) fail();
}

PlyWriter::PlyWriter(const fs::path& path, PlyLayout layout) : layout_(std::move(layout)), file_(path) {
  layout_.vertices = 0;
  if (layout_.triangles) {
    layout_.triangles = 0;
    faces_ = std::make_unique<OutputFile>(path.string() + ".faces");
  }
  file_.write(std::string(kHeader, ' '));
}

PlyWriter::~PlyWriter() {
  std::error_code ignored;
  if (faces_) fs::remove(faces_->path(), ignored);
}

void PlyWriter::add(const std::vector<std::array<uint32_t, 3>>& triangles) {
  std::string bytes;
  for (const auto& triangle : triangles) append_ply_triangle(bytes, triangle);
  faces_->write(bytes);
  *layout_.triangles += triangles.size();
}

std::string PlyWriter::header() const {
  std::string text = ply_header(layout_);
  const std::string comment = "comment ", end = "end_header\n";
  if (text.size() + comment.size() + 1 > kHeader) throw Error(file_.path().string() + ": its header is too long");
  const std::string padding = comment + std::string(kHeader - text.size() - comment.size() - 1, '-') + "\n";
  return text.insert(text.size() - end.size(), padding);
}

void PlyWriter::finish() {
  if (faces_) {
    faces_->close();
    std::ifstream faces(faces_->path(), std::ios::binary);
    std::vector<char> block(1 << 20);
    uint64_t copied = 0;
    while (faces.read(block.data(), static_cast<std::streamsize>(block.size())) || faces.gcount() > 0) {
      file_.write(block.data(), static_cast<size_t>(faces.gcount()));
      copied += static_cast<uint64_t>(faces.gcount());
    }
    if (copied != PlyBlocks::kTriangle * *layout_.triangles) throw Error(faces_->path().string() + ": cannot be read");
    fs::remove(faces_->path());
  }
  file_.rewrite(header());
  file_.close();
}

}  // namespace fringeslam

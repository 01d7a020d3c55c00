// SPDX-License-Identifier: Apache-2.0
// Reading of files from outside: a file is opened once, has to be regular, and has to be no larger than a limit that is
// checked before memory is allocated. Everything that reads a file that a user, another program or a network share may
// have written goes through here, so that a pipe, a device or an endless file ends with a message instead of a hang.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace fringeslam {

// Limits of file sizes; SECURITY.md lists them with those of other readers.
constexpr uint64_t kMebibyte = uint64_t{1} << 20;
constexpr uint64_t kMostTextBytes = 256 * kMebibyte;  // trajectories, lists of times, results of trials
constexpr uint64_t kMostImageFileBytes = 1024 * kMebibyte;
constexpr uint64_t kMostDataBytes = 65536 * kMebibyte;  // PLY: limited by what the file itself declares
constexpr uint64_t kMostMapBytes = uint64_t{1} << 40;   // saved maps, which are mapped and not read as a whole

// An open regular file. Throws Error if the path does not exist, is a folder, pipe, socket or device, cannot be opened,
// or has more than `most_bytes`.
class InputFile {
 public:
  InputFile(std::filesystem::path path, uint64_t most_bytes);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  uint64_t size() const { return size_; }  // bytes, when it was opened
  int descriptor() const { return descriptor_; }

  // Returns the content. Throws Error if reading fails or if the file grows beyond the limit meanwhile.
  std::string read() const;
  // Returns the first bytes, fewer if the file is shorter. Does not move the position of the descriptor.
  std::string head(size_t bytes) const;
  // Reads into `block` from `offset` on; returns the number of bytes read, 0 at the end of the file. Does not move the
  // position of the descriptor. Throws Error if reading fails.
  size_t read_at(uint64_t offset, char* block, size_t bytes) const;

 private:
  std::filesystem::path path_;
  uint64_t most_bytes_, size_ = 0;
  int descriptor_ = -1;
};

// Returns the content of a regular file; see InputFile.
std::string read_input(const std::filesystem::path& file, uint64_t most_bytes = kMostTextBytes);

// Returns the FNV-1a hash of the content of a regular file of up to kMostDataBytes, which is read in blocks; see InputFile.
uint64_t hash_input(const std::filesystem::path& file);

// Copies a regular file to a place where nothing exists. Throws Error like InputFile, or if the copy cannot be written.
void copy_input(const std::filesystem::path& from, const std::filesystem::path& to,
                uint64_t most_bytes = kMostImageFileBytes);

// Like copy_input(), for a regular file, or the regular files of a folder and its subfolders, that nobody changes: where the
// file system allows it, they are hard links, which take neither time nor space.
void link_input(const std::filesystem::path& from, const std::filesystem::path& to,
                uint64_t most_bytes = kMostImageFileBytes);
void link_input_folder(const std::filesystem::path& from, const std::filesystem::path& to,
                       uint64_t most_bytes = kMostImageFileBytes);

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/io/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <new>
#include <vector>

#include "core/base/fnv.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

std::string size_text(uint64_t bytes) {
  return bytes >= kMebibyte ? std::to_string(bytes / kMebibyte) + " MiB" : std::to_string(bytes) + " bytes";
}

[[noreturn]] void refuse_to_open(const std::filesystem::path& path, int error) {
  throw Error(path.string() + ": cannot be opened: " + std::strerror(error) +
              (error == EACCES ? "; check its permissions" : "; check the path"));
}

void check_kind(const std::filesystem::path& path, const struct stat& status) {
  if (S_ISDIR(status.st_mode)) throw Error(path.string() + ": is a folder; specify a file");
  if (!S_ISREG(status.st_mode))
    throw Error(path.string() + ": is not a regular file but a pipe, socket or device; copy its content to a file");
}

}  // namespace

InputFile::InputFile(std::filesystem::path path, uint64_t most_bytes)
    : path_(std::move(path)), most_bytes_(most_bytes) {
  struct stat status {};
  // Opening a device may already have effects.
  if (stat(path_.c_str(), &status) != 0) refuse_to_open(path_, errno);
  check_kind(path_, status);
  // Without O_NONBLOCK, opening would wait if a pipe had taken the file's place meanwhile.
  do {
    descriptor_ = open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
  } while (descriptor_ < 0 && errno == EINTR);
  if (descriptor_ < 0) refuse_to_open(path_, errno);
  try {
    if (fstat(descriptor_, &status) != 0) refuse_to_open(path_, errno);
    check_kind(path_, status);
    size_ = static_cast<uint64_t>(status.st_size);
    if (size_ > most_bytes_)
      throw Error(path_.string() + ": has " + size_text(size_) + ", but at most " + size_text(most_bytes_) +
                  " are read from a file of this kind");
  } catch (...) {
    close(descriptor_);
    throw;
  }
}

InputFile::~InputFile() { close(descriptor_); }

std::string InputFile::read() const {
  std::string bytes;
  try {
    // One more byte, so that the end of a file that does not grow is seen without a second allocation.
    bytes.resize(size_ + 1);
    size_t filled = 0;
    for (;;) {
      if (filled == bytes.size()) {
        if (filled > most_bytes_)
          throw Error(path_.string() + ": has more than " + size_text(most_bytes_) +
                      ", the limit for a file of this kind");
        bytes.resize(std::min<uint64_t>(2 * filled + 4096, most_bytes_ + 1));
      }
      const size_t count = read_at(filled, bytes.data() + filled, bytes.size() - filled);
      if (count == 0) break;
      filled += count;
    }
    bytes.resize(filled);
  } catch (const std::bad_alloc&) {
    throw Error(path_.string() + ": has " + size_text(size_) + ", for which memory does not suffice");
  }
  return bytes;
}

std::string InputFile::head(size_t bytes) const {
  std::string start(bytes, '\0');
  start.resize(read_at(0, start.data(), start.size()));
  return start;
}

size_t InputFile::read_at(uint64_t offset, char* block, size_t bytes) const {
  ssize_t count = 0;
  do {
    count = pread(descriptor_, block, bytes, static_cast<off_t>(offset));
  } while (count < 0 && errno == EINTR);
  if (count < 0) throw Error(path_.string() + ": cannot be read: " + std::strerror(errno));
  return static_cast<size_t>(count);
}

std::string read_input(const std::filesystem::path& file, uint64_t most_bytes) {
  return InputFile(file, most_bytes).read();
}

uint64_t hash_input(const std::filesystem::path& file) {
  const InputFile input(file, kMostDataBytes);
  std::vector<char> block(std::min<uint64_t>(input.size(), kMebibyte));
  uint64_t hash = fnv1a("");
  // A file that grows meanwhile ends where it did when it was opened.
  for (uint64_t hashed = 0; hashed < input.size();) {
    const size_t count = input.read_at(hashed, block.data(), std::min<uint64_t>(block.size(), input.size() - hashed));
    if (count == 0) break;
    hash = fnv1a({block.data(), count}, hash);
    hashed += count;
  }
  return hash;
}

void copy_input(const std::filesystem::path& from, const std::filesystem::path& to, uint64_t most_bytes) {
  const InputFile input(from, most_bytes);
  std::ofstream out(to, std::ios::binary);
  std::vector<char> block(std::min<uint64_t>(input.size() + 1, kMebibyte));
  for (uint64_t copied = 0; out;) {
    const size_t count = input.read_at(copied, block.data(), block.size());
    if (count == 0) break;
    copied += count;
    if (copied > most_bytes) throw Error(from.string() + ": grows while it is copied");
    out.write(block.data(), static_cast<std::streamsize>(count));
  }
  out.close();
  if (!out) throw Error(to.string() + ": cannot be written; check the folder and the free disk space");
}

void link_input(const std::filesystem::path& from, const std::filesystem::path& to, uint64_t most_bytes) {
  {
    // Links what was opened and checked, whatever has its name by now.
    const InputFile input(from, most_bytes);
    const std::string opened = "/proc/self/fd/" + std::to_string(input.descriptor());
    if (::linkat(AT_FDCWD, opened.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
  }
  copy_input(from, to, most_bytes);
}

void link_input_folder(const std::filesystem::path& from, const std::filesystem::path& to, uint64_t most_bytes) {
  std::error_code failed;
  std::filesystem::create_directory(to, failed);
  if (failed) throw Error(to.string() + ": cannot be created: " + failed.message());
  for (std::filesystem::directory_iterator entry(from, failed), end; !failed && entry != end; entry.increment(failed)) {
    // Folders are followed, links to folders are not: they may form a loop.
    std::error_code unknown;
    if (entry->symlink_status(unknown).type() == std::filesystem::file_type::directory)
      link_input_folder(entry->path(), to / entry->path().filename(), most_bytes);
    else
      link_input(entry->path(), to / entry->path().filename(), most_bytes);
  }
  if (failed) throw Error(from.string() + ": cannot be listed: " + failed.message());
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Files and folders that appear completely or not at all, whenever the process dies.
//
// They are written in a temporary folder NAME.partial-XXXXXX next to the target. It contains a marker file and is locked
// (flock) while its process lives, so that a later process recognizes and removes the leftovers of a dead one.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace fringeslam {

// Temporary folder next to `target`, on the same file system; removed by the destructor. The constructor also removes
// the temporary folders in that place whose processes have died. Throws Error if it cannot be created.
class PartialFolder {
 public:
  explicit PartialFolder(const std::filesystem::path& target);
  ~PartialFolder();
  PartialFolder(const PartialFolder&) = delete;
  PartialFolder& operator=(const PartialFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  // Keeps the folder under another name, which is returned: it is not removed, nor by later processes.
  std::filesystem::path keep();

 private:
  std::filesystem::path path_;
  int lock_ = -1;
  bool kept_ = false;
};

// Folder NAME.SUFFIX-XXXXXX next to `target` for work in progress that later processes can continue when this one dies. It is
// marked and locked like a PartialFolder, but stays until remove() is called.
class WorkFolder {
 public:
  // Creates a folder. Throws Error if that fails.
  WorkFolder(const std::filesystem::path& target, const std::string& suffix);
  // Takes over the folder of a process that has died. Throws Error if the process lives, or if the folder is not one of
  // ours.
  static WorkFolder taken_over(const std::filesystem::path& folder);
  // Folders of this user next to `target` whose processes have died, in the order of their names.
  static std::vector<std::filesystem::path> left(const std::filesystem::path& target, const std::string& suffix);

  ~WorkFolder();
  WorkFolder(WorkFolder&& other) noexcept;
  WorkFolder& operator=(WorkFolder&&) = delete;

  const std::filesystem::path& path() const { return path_; }
  // Removes the folder with its files.
  void remove();

 private:
  WorkFolder() = default;
  std::filesystem::path path_;
  int lock_ = -1;
};

// Folder that appears under its final name only when complete: commit() renames it, or exchanges it with an existing
// folder, in one system call. An existing target is replaced only if it is empty or was written by this class with the
// same kind ("run", "dataset"); otherwise the constructor throws Error. With an empty kind, only an empty folder is
// replaced.
//
// A written folder lists its files in .fringeslam. Files in a replaced folder that are not listed, or are named in
// `preserved`, were not written by the result that is replaced: they are kept. If the new result has a file of the same
// name, the old one is kept as NAME.kept, unless it is `preserved`, which the new one replaces.
class StagedFolder {
 public:
  StagedFolder(std::filesystem::path target, std::string kind, std::vector<std::string> preserved = {});
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;

  const std::filesystem::path& path() const { return staging_; }
  // The final folder, without links.
  const std::filesystem::path& target() const { return target_; }
  // Changes target() and path(): the result appears as another folder in the same place, to which the same rules apply.
  void redirect(std::filesystem::path target);
  void commit();

 private:
  std::filesystem::path target_;
  std::string kind_;
  std::vector<std::string> preserved_;
  std::unique_ptr<PartialFolder> partial_;
  std::filesystem::path staging_;
};

// Returns true if replacing the folder `target` by a StagedFolder with these `preserved` files would remove `path`, or a file in it:
// it lies in the folder, or is the folder, and the result that is replaced wrote it.
bool is_replaced_with(const std::filesystem::path& path, const std::filesystem::path& target,
                      const std::vector<std::string>& preserved = {});

// File, with any accompanying files, that appears only when complete: all files are written under their final names
// into a temporary folder next to the target. commit() moves them into the target's folder, the target last; the
// destructor removes anything left over.
class StagedFile {
 public:
  explicit StagedFile(std::filesystem::path target);
  StagedFile(const StagedFile&) = delete;
  StagedFile& operator=(const StagedFile&) = delete;

  std::filesystem::path path() const { return partial_->path() / target_.filename(); }
  // The file to be written, without links.
  const std::filesystem::path& target() const { return target_; }
  // Names of the accompanying files.
  std::vector<std::string> companions() const;
  // Throws Error, and changes nothing, if an accompanying file would replace a file that is not among `replaceable`, the
  // names of those that belong to the target that is replaced.
  void commit(const std::set<std::string>& replaceable = {});
  // Keeps an incomplete file as TARGET.unfinished, or with a number if that exists, and returns this name. Throws Error if that
  // fails.
  std::filesystem::path keep_unfinished();

 private:
  std::filesystem::path target_;
  std::optional<PartialFolder> partial_;
};

// Writes a file that appears, or replaces an existing one, only when complete. Devices and pipes are written to.
void write_text(const std::filesystem::path& file, const std::string& text);

// Like write_text(), but replaces a device, a pipe or a link instead of writing to it: for files that no user names.
void write_regular_file(const std::filesystem::path& file, const std::string& text);

// Returns `text` with the names of files in temporary folders replaced by the names they get when complete: messages
// should not name a folder that no longer exists when they are read.
std::string with_final_names(const std::string& text);

// Waits until all files below `folder` are on the disk. Throws Error if they cannot be written.
void sync_folder(const std::filesystem::path& folder);

// Waits until a file, or the list of a folder's entries, is on the disk. Throws Error if it cannot be written.
void sync_entry(const std::filesystem::path& path);

}  // namespace fringeslam

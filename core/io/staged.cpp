// SPDX-License-Identifier: Apache-2.0
#include "core/io/staged.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <set>
#include <sstream>
#include <tuple>
#include <utility>

#include "core/io/input_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

// Marker file in folders written by StagedFolder: the kind, then the names of all other files, one per line.
constexpr const char* kMarkerFile = ".fringeslam";
// Marker file in temporary folders: host, process and start time of the process.
constexpr const char* kPartialMarker = ".fringeslam-partial";
constexpr std::string_view kPartialSuffix = ".partial-";
constexpr size_t kPartialLetters = 6;
// Mode of a new temporary folder. The sticky bit distinguishes it from a folder of the user before it has its marker.
constexpr mode_t kPartialMode = S_ISVTX | S_IRWXU;
// In a temporary folder: the replaced folder, on file systems that cannot exchange two folders.
constexpr const char* kReplaced = ".replaced";
// Beyond this number of files, the whole file system is synchronized instead of file after file.
constexpr size_t kMostSynced = 64;

// Calls a system call again while a signal interrupts it.
template <class Call>
auto uninterrupted(const Call& call) {
  auto result = call();
  while (result < 0 && errno == EINTR) result = call();
  return result;
}

class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  operator int() const { return number_; }
  int release() { return std::exchange(number_, -1); }

 private:
  int number_;
};

fs::path parent_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : fs::path("."); }

bool is_there(const fs::path& file) {
  struct stat status {};
  return lstat(file.c_str(), &status) == 0;
}

// True if a temporary folder has its marker. Anything else of that name, such as a pipe, is not ours.
bool is_marked(const fs::path& folder) {
  struct stat status {};
  return lstat((folder / kPartialMarker).c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

// Throws Error for a link to nothing, which would be replaced instead of followed.
void refuse_dangling(const fs::path& file) {
  std::error_code failed;
  struct stat status {};
  if (fs::is_symlink(file, failed) && stat(file.c_str(), &status) != 0 && errno == ENOENT)
    throw Error(file.string() + ": is a link to a file that does not exist; remove the link or create the file");
}

Error cannot(const fs::path& file, const char* what, int error = errno) {
  return Error(file.string() + ": cannot be " + what + ": " + std::strerror(error));
}

// Returns the position after a temporary folder's suffix that starts at `at`, or npos.
size_t end_of_suffix(std::string_view text, size_t at, std::string_view suffix = kPartialSuffix) {
  const size_t letters = at + suffix.size();
  if (text.substr(at, suffix.size()) != suffix || letters + kPartialLetters > text.size())
    return std::string_view::npos;
  const std::string_view tag = text.substr(letters, kPartialLetters);
  const bool random = std::all_of(tag.begin(), tag.end(), [](unsigned char c) { return std::isalnum(c) != 0; });
  return random ? letters + kPartialLetters : std::string_view::npos;
}

// Returns when a process was started, in clock ticks since the computer was; empty if there is no such process.
std::string start_of(const std::string& process) {
  const std::string file = "/proc/" + process + "/stat";
  std::string text;
  try {
    text = read_input(file, 1 << 16);
  } catch (const Error&) {
    return "";
  }
  // The name in parentheses may contain blanks; the start is the 20th word after it.
  std::istringstream words(text.substr(std::min(text.rfind(')') + 1, text.size())));
  std::string word;
  for (int i = 0; i < 20; ++i) words >> word;
  return words ? word : "";
}

std::string host_name() {
  char name[256] = "";
  return gethostname(name, sizeof name - 1) == 0 && name[0] != '\0' ? name : "?";
}

std::string owner_of_this_process() {
  const std::string process = std::to_string(getpid());
  return host_name() + " " + process + " " + start_of("self") + "\n";
}

// For file systems without locks. A process of another computer cannot be examined; it counts as alive.
bool is_owner_alive(const fs::path& folder) {
  std::string host, process, start;
  try {
    std::istringstream(read_input(folder / kPartialMarker, 1 << 12)) >> host >> process >> start;
  } catch (const Error&) {
    return true;
  }
  const bool numeric =
      std::all_of(process.begin(), process.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
  if (host != host_name() || process.empty() || !numeric) return true;
  return start_of(process) == start;
}

// The marker is removed last: until then the folder is recognized if this process dies.
void remove_partial(const fs::path& folder) {
  std::error_code failed;
  bool all = true;
  for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end; entry.increment(failed)) {
    if (entry->path().filename() == kPartialMarker) continue;
    std::error_code left;
    fs::remove_all(entry->path(), left);
    all &= !left;
  }
  if (failed || !all) return;
  (void)unlink((folder / kPartialMarker).c_str());
  (void)rmdir(folder.c_str());
}

// Locks a temporary folder if it is ours, marked, and its process is dead; -1: it is not. A folder without a marker is
// removed if it has the mode of a new one and is empty: its process died, or is about to notice, between creating and
// marking it. Any other folder is the user's.
int lock_leftover(const fs::path& folder) {
  Descriptor lock(uninterrupted([&] { return open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC); }));
  if (lock < 0) return -1;
  struct stat status {};
  if (fstat(lock, &status) != 0 || status.st_uid != geteuid()) return -1;
  const bool marked = is_marked(folder);
  if (flock(lock, LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK || errno == EINTR || !marked || is_owner_alive(folder)) return -1;
  }
  if (marked) return lock.release();
  if ((status.st_mode & (S_ISVTX | 0777)) == kPartialMode) (void)rmdir(folder.c_str());
  return -1;
}

void remove_leftover(const fs::path& folder, const fs::path& target) {
  const Descriptor lock(lock_leftover(folder));
  if (lock < 0) return;
  // Its process died while it replaced a folder without RENAME_EXCHANGE.
  if (is_there(folder / kReplaced) && !is_there(target)) (void)rename((folder / kReplaced).c_str(), target.c_str());
  if (is_there(folder / kReplaced) && !is_there(target)) return;
  remove_partial(folder);
}

// Temporary folders in `parent`, and their targets.
std::vector<std::pair<fs::path, fs::path>> temporary_folders(const fs::path& parent, std::string_view suffix) {
  std::vector<std::pair<fs::path, fs::path>> found;
  std::error_code failed;
  for (fs::directory_iterator entry(parent, failed), end; !failed && entry != end; entry.increment(failed)) {
    const std::string name = entry->path().filename().string();
    const size_t at = name.rfind(suffix);
    if (at == std::string::npos || at == 0 || end_of_suffix(name, at, suffix) != name.size()) continue;
    found.emplace_back(parent / name, parent / name.substr(0, at));
  }
  return found;
}

void remove_leftovers_in(const fs::path& parent) {
  for (const auto& [folder, target] : temporary_folders(parent, kPartialSuffix)) remove_leftover(folder, target);
}

// Writes all bytes; returns 0 or the error.
int write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = uninterrupted([&] { return write(descriptor, bytes.data(), bytes.size()); });
    if (written < 0) return errno;
    if (written == 0) return EIO;
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return 0;
}

// Opens a pipe for writing. Waits two seconds for its reader, unlike open(), which waits for ever.
int open_pipe(const fs::path& pipe) {
  constexpr int kAttempts = 20;
  constexpr useconds_t kPause_us = 100'000;
  for (int attempt = 1;; ++attempt) {
    const int out = uninterrupted([&] { return open(pipe.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC); });
    if (out >= 0 && fcntl(out, F_SETFL, 0) == 0) return out;
    if (out >= 0 || errno != ENXIO) return out;
    if (attempt == kAttempts) throw Error(pipe.string() + ": is a pipe that no program reads; start the reader first");
    usleep(kPause_us);
  }
}

// Creates or overwrites a file in place.
void write_directly(const fs::path& file, const fs::path& named, std::string_view bytes) {
  Descriptor out(uninterrupted([&] { return open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666); }));
  if (out < 0) throw cannot(named, "written");
  if (const int error = write_all(out, bytes); error != 0) throw cannot(named, "written", error);
  if (close(out.release()) != 0 && errno != EINTR) throw cannot(named, "written");
}

// Writes a new file without ever showing a part of it: the file has no name until it is complete. Returns false if the
// name exists already or the file system cannot do this.
bool write_new(const fs::path& file, std::string_view bytes) {
  const fs::path folder = parent_of(file);
  Descriptor out(uninterrupted([&] { return open(folder.c_str(), O_WRONLY | O_TMPFILE | O_CLOEXEC, 0666); }));
  if (out < 0) return false;
  if (const int error = write_all(out, bytes); error != 0) throw cannot(file, "written", error);
  const std::string unnamed = "/proc/self/fd/" + std::to_string(out);
  return uninterrupted([&] { return linkat(AT_FDCWD, unnamed.c_str(), AT_FDCWD, file.c_str(), AT_SYMLINK_FOLLOW); }) ==
         0;
}

// Waits until a file or folder is on the disk. File systems that cannot do so for a folder say EINVAL. What we may not read was kept
// from another result, not written.
void sync(const fs::path& path, const fs::path& named) {
  const Descriptor descriptor(uninterrupted([&] { return open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); }));
  if (descriptor < 0 && errno == EACCES) return;
  if (descriptor < 0) throw cannot(named, "written");
  if (uninterrupted([&] { return fsync(descriptor); }) != 0 && errno != EINVAL && errno != EROFS)
    throw cannot(named, "written to the disk");
}

// Returns the names of all files below `folder`, relative to it and sorted; folders are not listed.
std::vector<std::string> files_below(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code failed;
  for (fs::recursive_directory_iterator entry(folder, failed), end; entry != end; entry.increment(failed)) {
    if (failed) break;
    std::error_code unknown;
    if (entry->symlink_status(unknown).type() == fs::file_type::directory) continue;
    names.push_back(entry->path().lexically_relative(folder).generic_string());
  }
  if (failed) throw Error(folder.string() + ": cannot be listed: " + failed.message());
  std::sort(names.begin(), names.end());
  return names;
}

// Information in a folder's marker.
struct Written {
  std::string kind;                            // empty: not written by StagedFolder
  std::optional<std::set<std::string>> files;  // names; empty: the marker does not list them
  struct timespec at {};                       // when the marker was written
};

Written written(const fs::path& folder) {
  Written result;
  // A marker that cannot be read is an error: without its list, files of the old result would count as the user's.
  if (!is_there(folder / kMarkerFile)) return result;
  const std::string text = read_input(folder / kMarkerFile, kMostTextBytes);
  std::istringstream lines(text);
  std::getline(lines, result.kind);
  for (std::string name; std::getline(lines, name);) {
    if (!result.files) result.files.emplace();
    result.files->insert(name);
  }
  struct stat status {};
  if (stat((folder / kMarkerFile).c_str(), &status) == 0) result.at = status.st_ctim;
  return result;
}

bool is_later(const timespec& a, const timespec& b) {
  return a.tv_sec != b.tv_sec ? a.tv_sec > b.tv_sec : a.tv_nsec > b.tv_nsec;
}

// True if the result `old` did not write this file. Without a list of its files, those that changed or arrived after its
// completion are not its own.
bool is_foreign(const fs::path& old_folder, const Written& old, const std::string& name) {
  if (name == kMarkerFile) return false;
  if (old.files) return !old.files->contains(name);
  struct stat status {};
  return lstat((old_folder / name).c_str(), &status) != 0 || is_later(status.st_ctim, old.at);
}

// Returns a name for `file` that nothing has, or for a folder, that nothing but a folder has.
fs::path free_name(const fs::path& file, bool is_folder = false) {
  const auto taken = [&](const fs::path& name) {
    std::error_code failed;
    return is_there(name) && !(is_folder && fs::symlink_status(name, failed).type() == fs::file_type::directory);
  };
  fs::path name = file.string() + ".kept";
  for (int number = 2; taken(name); ++number) name = file.string() + ".kept" + std::to_string(number);
  return name;
}

// Returns the place for `name` in `folder`, in subfolders of other names where files have those of its own.
fs::path place_in(const fs::path& folder, const fs::path& name) {
  fs::path place = folder;
  for (const fs::path& part : name.parent_path()) {
    place /= part;
    std::error_code failed;
    if (is_there(place) && fs::symlink_status(place, failed).type() != fs::file_type::directory)
      place = free_name(place, true);
  }
  return place / name.filename();
}

// Makes the same file appear at a second place, without copying it if possible.
void duplicate(const fs::path& from, const fs::path& to, const fs::path& named) {
  std::error_code failed;
  fs::create_directories(to.parent_path(), failed);
  if (!failed && linkat(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), 0) == 0) return;
  if (!failed) fs::copy(from, to, fs::copy_options::copy_symlinks, failed);
  if (failed) throw Error(named.string() + ": cannot be kept when the folder is replaced: " + failed.message());
}

// Adds to `next` the files of `old_folder` that must survive its replacement, but for those in `done`.
void carry_over(const fs::path& old_folder, const fs::path& next, const std::vector<std::string>& preserved,
                const fs::path& target, std::set<std::string>& done) {
  const Written old = written(old_folder);
  for (const std::string& name : files_below(old_folder)) {
    const bool keep = std::find(preserved.begin(), preserved.end(), name) != preserved.end();
    if (done.contains(name) || (!keep && !is_foreign(old_folder, old, name))) continue;
    const fs::path place = place_in(next, name);
    const bool taken = is_there(place);
    if (!taken || (!keep && old.files)) duplicate(old_folder / name, taken ? free_name(place) : place, target / name);
    done.insert(name);
  }
}

// Creates the folders that the old result did not write in `next`, as carry_over() names them, with their permissions.
void carry_folders_over(const fs::path& old_folder, const fs::path& next) {
  const Written old = written(old_folder);
  if (!old.files) return;
  std::error_code failed;
  for (fs::recursive_directory_iterator entry(old_folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    std::error_code unknown;
    if (entry->symlink_status(unknown).type() != fs::file_type::directory) continue;
    const std::string name = entry->path().lexically_relative(old_folder).generic_string() + "/";
    const auto first = old.files->lower_bound(name);
    if (first != old.files->end() && first->starts_with(name)) continue;
    const fs::path place = place_in(next, name + kPartialMarker).parent_path();
    std::error_code ignored;
    fs::create_directories(place, ignored);
    fs::permissions(place, entry->status(unknown).permissions(), ignored);
  }
}

bool is_empty_folder(const fs::path& folder) {
  std::error_code failed;
  return fs::is_directory(folder, failed) && fs::is_empty(folder, failed) && !failed;
}

// Throws Error if a folder of this kind may not replace what is at `target`.
void check_replaceable(const fs::path& target, const std::string& kind) {
  if (!is_there(target)) return;
  if (!is_empty_folder(target) && (kind.empty() || written(target).kind != kind))
    throw Error(target.string() + ": exists" + (kind.empty() ? "" : " and was not written by fringeslam as a " + kind) +
                "; choose another --out or remove it");
}

bool is_within(fs::path path, const fs::path& folder) {
  std::error_code failed;
  for (; !path.empty(); path = path.parent_path()) {
    if (fs::equivalent(path, folder, failed)) return true;
    if (path == path.parent_path()) break;
  }
  return false;
}

// Returns the folder to create or replace. Everything that would make commit() fail is refused here, before the work.
fs::path checked_target(fs::path target, const std::string& kind) {
  if (target.empty()) throw Error("--out: the name of the folder is empty");
  const fs::path given = target;
  while ((target.filename().empty() || target.filename() == ".") && target.has_parent_path() &&
         target.parent_path() != target)
    target = target.parent_path();
  std::error_code failed;
  const bool indirect = target.filename() == "." || target.filename() == ".." || fs::is_symlink(target, failed);
  if (indirect) {
    if (!fs::exists(target, failed))
      throw Error(given.string() + ": is a link to a folder that does not exist; remove the link or create the folder");
    target = fs::canonical(target, failed);
    if (failed) throw Error(given.string() + ": cannot be resolved: " + failed.message());
  }
  check_replaceable(target, kind);
  const fs::path parent = parent_of(target);
  struct stat own {
  }, above{};
  if (lstat(target.c_str(), &own) == 0 && stat(parent.c_str(), &above) == 0) {
    const fs::path here = fs::current_path(failed);
    if (!failed && is_within(here, target))
      throw Error(given.string() +
                  ": is the current folder or contains it, so it cannot be replaced; name a new folder");
    if (S_ISDIR(own.st_mode) && access(target.c_str(), W_OK) != 0)
      throw Error(given.string() + ": is not writable; choose another --out or change its permissions");
    if (S_ISDIR(own.st_mode)) (void)files_below(target);  // must be possible to keep those of others
    if (own.st_dev != above.st_dev)
      throw Error(given.string() + ": is a mount point, which cannot be replaced; name a folder below it");
  }
  fs::create_directories(parent, failed);
  if (failed) throw Error(target.string() + ": cannot create its parent folder: " + failed.message());
  return target;
}

// Renames with flags where the kernel and the file system support it. Returns 0 or the error.
int rename_as(const fs::path& from, const fs::path& to, unsigned flags) {
  return uninterrupted([&] { return renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), flags); }) == 0 ? 0 : errno;
}

// Replaces a folder in two steps, for file systems that cannot exchange folders. remove_leftover() restores the old one
// if the process dies between them. Returns 0 or the error.
int replace_in_two_steps(const fs::path& next, const fs::path& target, const fs::path& replaced) {
  if (const int error = rename_as(target, replaced, 0); error != 0) return error;
  const int error = rename_as(next, target, 0);
  if (error != 0) (void)rename_as(replaced, target, 0);
  return error;
}

std::string random_letters() {
  constexpr std::string_view kLetters = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";
  std::random_device random;
  std::string letters;
  for (size_t i = 0; i < kPartialLetters; ++i) letters += kLetters[random() % kLetters.size()];
  return letters;
}

// Creates, locks and marks a folder next to `target`; returns its path and lock.
std::pair<fs::path, int> create_marked_folder(const fs::path& target, std::string_view suffix) {
  constexpr int kAttempts = 100;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const fs::path path = target.string() + std::string(suffix) + random_letters();
    if (mkdir(path.c_str(), kPartialMode) != 0) {
      if (errno == EEXIST) continue;
      if (errno != ENAMETOOLONG) throw cannot(target, "written");
      throw Error(target.string() + ": the name is too long, because that of a temporary folder beside it has " +
                  std::to_string(suffix.size() + kPartialLetters) + " letters more; choose a shorter --out");
    }
    const int lock = uninterrupted([&] { return open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); });
    if (lock >= 0) {
      (void)uninterrupted([&] { return flock(lock, LOCK_EX); });
      try {
        write_directly(path / kPartialMarker, target, owner_of_this_process());
        return {path, lock};
      } catch (...) {
        const bool removed = !is_there(path);
        unlink((path / kPartialMarker).c_str());  // empty, if the disk is full
        rmdir(path.c_str());
        close(lock);
        if (!removed) throw;
      }
    } else if (errno != ENOENT) {
      const int error = errno;
      rmdir(path.c_str());
      throw cannot(target, "written", error);
    }
    // Another process removed the folder while it was empty and not locked.
  }
  throw Error(target.string() + ": cannot be written: no temporary folder can be created beside it");
}

}  // namespace

bool is_replaced_with(const fs::path& path, const fs::path& target, const std::vector<std::string>& preserved) {
  if (!is_there(target / kMarkerFile)) return false;
  std::error_code failed;
  const fs::path folder = fs::weakly_canonical(target, failed), file = fs::weakly_canonical(path, failed);
  const fs::path inside = file.lexically_relative(folder);
  if (inside.empty() || *inside.begin() == "..") return false;
  const Written old = written(folder);
  const auto is_removed = [&](const fs::path& name) {
    const std::string text = name.lexically_normal().generic_string();
    return std::find(preserved.begin(), preserved.end(), text) == preserved.end() && !is_foreign(folder, old, text);
  };
  if (!fs::is_directory(file, failed)) return is_there(file) && is_removed(inside);
  const std::vector<std::string> names = files_below(file);
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) { return is_removed(inside / name); });
}

PartialFolder::PartialFolder(const fs::path& target) {
  remove_leftovers_in(parent_of(target));
  std::tie(path_, lock_) = create_marked_folder(target, kPartialSuffix);
}

PartialFolder::~PartialFolder() {
  if (!kept_) remove_partial(path_);
  close(lock_);
}

fs::path PartialFolder::keep() {
  kept_ = true;
  (void)unlink((path_ / kPartialMarker).c_str());
  std::string name = path_.string();
  name.replace(name.size() - kPartialLetters - kPartialSuffix.size(), kPartialSuffix.size(), ".kept-");
  return rename(path_.c_str(), name.c_str()) == 0 ? fs::path(name) : path_;
}

WorkFolder::WorkFolder(const fs::path& target, const std::string& suffix) {
  std::tie(path_, lock_) = create_marked_folder(target, "." + suffix + "-");
  sync(parent_of(target), target);  // its files are of no use in a folder that a loss of power removes
}

WorkFolder WorkFolder::taken_over(const fs::path& folder) {
  if (!is_marked(folder)) throw Error(folder.string() + ": was not left by FringeSLAM");
  WorkFolder taken;
  taken.lock_ = lock_leftover(folder);
  if (taken.lock_ < 0) throw Error(folder.string() + ": is in use by a running process, or belongs to another user");
  taken.path_ = folder;
  // Where locks do not work, the marker names the owner: from now on this process.
  write_directly(folder / kPartialMarker, folder / kPartialMarker, owner_of_this_process());
  return taken;
}

std::vector<fs::path> WorkFolder::left(const fs::path& target, const std::string& suffix) {
  std::vector<fs::path> found;
  for (const auto& [folder, of] : temporary_folders(parent_of(target), "." + suffix + "-")) {
    if (of.filename() != target.filename()) continue;
    const Descriptor lock(lock_leftover(folder));
    if (lock >= 0) found.push_back(folder);
  }
  std::sort(found.begin(), found.end());
  return found;
}

WorkFolder::~WorkFolder() {
  if (lock_ >= 0) close(lock_);
}

WorkFolder::WorkFolder(WorkFolder&& other) noexcept
    : path_(std::move(other.path_)), lock_(std::exchange(other.lock_, -1)) {}

void WorkFolder::remove() { remove_partial(path_); }

StagedFolder::StagedFolder(fs::path target, std::string kind, std::vector<std::string> preserved)
    : target_(checked_target(std::move(target), kind)), kind_(std::move(kind)), preserved_(std::move(preserved)) {
  partial_ = std::make_unique<PartialFolder>(target_);
  staging_ = partial_->path() / target_.filename();
  std::error_code failed;
  fs::create_directory(staging_, failed);
  if (failed) throw Error(target_.string() + ": cannot be written: " + failed.message());
}

void StagedFolder::redirect(fs::path target) {
  fs::path checked = checked_target(std::move(target), kind_);
  auto partial = std::make_unique<PartialFolder>(checked);
  fs::path staging = partial->path() / checked.filename();
  if (const int error = rename_as(staging_, staging, 0); error != 0) throw cannot(checked, "written", error);
  target_ = std::move(checked);
  staging_ = std::move(staging);
  partial_ = std::move(partial);
}

void StagedFolder::commit() {
  if (!kind_.empty()) {
    std::string text = kind_ + "\n";
    for (const std::string& name : files_below(staging_)) text += name + "\n";
    write_directly(staging_ / kMarkerFile, target_ / kMarkerFile, text);
  }
  std::set<std::string> carried_over;
  bool synced = false, syncing = false, replaces = false;
  try {
    int error = 0;
    // Another process may create or remove the target meanwhile.
    constexpr int kAttempts = 10;
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      check_replaceable(target_, kind_);
      replaces = is_there(target_);
      if (replaces) {
        carry_over(target_, staging_, preserved_, target_, carried_over);
        carry_folders_over(target_, staging_);
      }
      if (!synced) {
        syncing = true;
        sync_folder(staging_);
        syncing = false, synced = true;
      }
      error = rename_as(staging_, target_, replaces ? RENAME_EXCHANGE : RENAME_NOREPLACE);
      if (error == EINVAL || error == ENOSYS || error == EOPNOTSUPP)
        error = replaces ? replace_in_two_steps(staging_, target_, partial_->path() / kReplaced)
                         : rename_as(staging_, target_, 0);
      if (error != EEXIST && error != ENOENT) break;
    }
    if (error != 0) throw cannot(target_, "moved into place", error);
  } catch (const std::exception& e) {
    if (syncing) throw;  // what did not reach the disk is not complete
    // The work is done. What stands in its way may be anything.
    throw Error(std::string(e.what()) + "; the new result is complete in " +
                (partial_->keep() / target_.filename()).string());
  }
  // Files that arrived after the first pass.
  if (replaces) {
    const fs::path old = is_there(staging_) ? staging_ : partial_->path() / kReplaced;
    try {
      carry_over(old, target_, preserved_, target_, carried_over);
      carry_folders_over(old, target_);
    } catch (const Error& e) {
      throw Error(std::string(e.what()) + "; the new result is complete, the replaced one is kept in " +
                  partial_->keep().string());
    }
  }
  sync(parent_of(target_), target_);
  partial_.reset();
}

StagedFile::StagedFile(fs::path target) : target_(std::move(target)) {
  std::error_code failed;
  if (target_.empty()) throw Error("--out: the name of the file is empty");
  if (target_.filename().empty() || fs::is_directory(target_, failed))
    throw Error(target_.string() + ": cannot be written: it is a folder");
  refuse_dangling(target_);
  if (fs::is_symlink(target_, failed)) target_ = fs::canonical(target_, failed);
  if (fs::exists(target_, failed) && !fs::is_regular_file(target_, failed))
    throw Error(target_.string() + ": is a device or a pipe, which cannot be replaced; name a file");
  partial_.emplace(target_);
}

std::vector<std::string> StagedFile::companions() const {
  std::vector<std::string> names = files_below(partial_->path());
  std::erase_if(names, [&](const std::string& name) { return name == kPartialMarker || name == target_.filename(); });
  return names;
}

void StagedFile::commit(const std::set<std::string>& replaceable) {
  std::vector<std::string> names = companions();
  const fs::path folder = parent_of(target_);
  for (const std::string& name : names) {
    if (is_there(folder / name) && !replaceable.contains(name))
      throw Error((folder / name).string() + ": exists and was not written with " + target_.filename().string() +
                  ", but would be replaced; choose another --out or move it away");
  }
  names.push_back(target_.filename().string());
  for (const std::string& name : names) sync(partial_->path() / name, folder / name);
  for (const std::string& name : names) {
    const int error = rename_as(partial_->path() / name, folder / name, 0);
    if (error != 0) throw cannot(folder / name, "written", error);
  }
  sync(folder, target_);
}

fs::path StagedFile::keep_unfinished() {
  constexpr int kMost = 1000;
  int error = EEXIST;
  fs::path kept;
  for (int number = 1; error == EEXIST && number <= kMost; ++number) {
    kept = target_.string() + (number == 1 ? ".unfinished" : "." + std::to_string(number) + ".unfinished");
    error = rename_as(path(), kept, RENAME_NOREPLACE);
  }
  if (error != 0) throw cannot(kept, "written", error);
  sync(parent_of(target_), kept);
  return kept;
}

namespace {

// Moves a new file to `target` when it is complete. A `mode` of 0 is that of new files.
void replace_file(const fs::path& target, const fs::path& named, const std::string& text, mode_t mode) {
  const PartialFolder partial(target);
  const fs::path next = partial.path() / target.filename();
  write_directly(next, named, text);
  if (mode != 0) (void)chmod(next.c_str(), mode & 07777);
  if (const int error = rename_as(next, target, 0); error != 0) throw cannot(named, "written", error);
}

}  // namespace

void write_text(const fs::path& file, const std::string& text) {
  struct stat status {};
  if (stat(file.c_str(), &status) != 0) {
    refuse_dangling(file);
    if (write_new(file, text)) return;
    if (stat(file.c_str(), &status) != 0 && errno != ENOENT) throw cannot(file, "written");
  }
  if (S_ISDIR(status.st_mode)) throw Error(file.string() + ": cannot be written: it is a folder");
  if (S_ISFIFO(status.st_mode)) {
    Descriptor out(open_pipe(file));
    const int error = out < 0 ? errno : write_all(out, text);
    if (error != 0) throw cannot(file, "written", error);
    return;
  }
  if (status.st_mode != 0 && !S_ISREG(status.st_mode)) return write_directly(file, file, text);
  std::error_code ignored;
  const bool link = fs::is_symlink(file, ignored) && fs::exists(file, ignored);
  replace_file(link ? fs::canonical(file, ignored) : file, file, text, status.st_mode);
}

void write_regular_file(const fs::path& file, const std::string& text) {
  if (!write_new(file, text)) replace_file(file, file, text, 0);
}

std::string with_final_names(const std::string& text) {
  std::string result;
  size_t begin = 0;
  for (size_t at; (at = text.find(kPartialSuffix, begin)) != std::string::npos;) {
    const size_t end = end_of_suffix(text, at);
    if (end == std::string::npos) {
      result += text.substr(begin, at + 1 - begin);
      begin = at + 1;
      continue;
    }
    // A name's first letter follows a separator. A staged folder is in NAME.partial-XXXXXX/NAME.
    const auto starts_name = [&](size_t place) {
      return place == begin || text[place - 1] == '/' || text[place - 1] == ' ';
    };
    size_t length = 0;
    if (end < text.size() && text[end] == '/') {
      for (size_t n = std::min(at - begin, text.size() - end - 1); n > 0 && length == 0; --n) {
        if (starts_name(at - n) && text.compare(at - n, n, text, end + 1, n) == 0) length = n;
      }
    }
    if (length > 0) {
      result += text.substr(begin, at - begin);
      begin = end + 1 + length;
      continue;
    }
    size_t name = at;
    if (end < text.size() && text[end] == '/') {
      while (!starts_name(name)) --name;
    }
    result += text.substr(begin, name - begin);
    begin = name < at ? end + 1 : end;
  }
  return result + text.substr(begin);
}

void sync_folder(const fs::path& folder) {
  const std::vector<std::string> files = files_below(folder);
  if (files.size() > kMostSynced) {
    const Descriptor descriptor(
        uninterrupted([&] { return open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); }));
    if (descriptor < 0 || uninterrupted([&] { return syncfs(descriptor); }) != 0)
      throw cannot(folder, "written to the disk");
    return;
  }
  std::set<fs::path> folders = {folder};
  for (const std::string& name : files) {
    const fs::path file = folder / name;
    std::error_code failed;
    if (fs::symlink_status(file, failed).type() == fs::file_type::regular) sync(file, file);
    for (fs::path above = file.parent_path(); folders.insert(above).second;) above = above.parent_path();
  }
  for (const fs::path& each : folders) sync(each, each);
}

void sync_entry(const fs::path& path) { sync(path, path); }

}  // namespace fringeslam

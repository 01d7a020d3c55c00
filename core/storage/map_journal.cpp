// SPDX-License-Identifier: Apache-2.0
#include "core/storage/map_journal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <tuple>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/shell.h"
#include "core/io/input_file.h"
#include "core/landmarks/recognition.h"
#include "core/storage/map_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr const char *kIndexFile = "index", *kBaseFile = "base.map";
constexpr int kOwn = 0, kBase = 1, kFiles = 2;
// With the time to write, what is lost is less than a second old.
constexpr std::chrono::milliseconds kInterval{400};

bool is_same_file(const fs::path& a, const fs::path& b) {
  struct stat of_a {
  }, of_b{};
  return ::stat(a.c_str(), &of_a) == 0 && ::stat(b.c_str(), &of_b) == 0 && of_a.st_dev == of_b.st_dev &&
         of_a.st_ino == of_b.st_ino;
}

// Links the file that is mapped, even if another one has taken its name; where links are not possible, its name; copies it if that
// is no longer its name.
void link_base(const MappedFile& base, const fs::path& to) {
  const std::string open_file = "/proc/self/fd/" + std::to_string(base.descriptor());
  if (::linkat(AT_FDCWD, open_file.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
  std::error_code failed;
  const fs::path name = fs::read_symlink(open_file, failed);
  if (!failed && is_same_file(open_file, name))
    fs::create_symlink(name, to, failed);
  else
    fs::copy_file(open_file, to, failed);
  if (failed) throw Error(to.string() + ": cannot be written: " + failed.message());
}

IndexOfFile read_journal_index(const fs::path& folder) {
  return read_index(read_input(folder / kIndexFile, kMostDataBytes), (folder / kIndexFile).string(), kFiles);
}

// Appends the parts that lie in the base, and the index.
void complete(MapIndex& index, MapParts& parts, const MappedFile* base) {
  const auto move = [&](StoredPart& part) {
    if (part.file == kBase) part = parts.add(*base, part);
  };
  for (MapIndex::KeyframeEntry& keyframe : index.keyframes) {
    for (StoredPart* const part : {&keyframe.images, &keyframe.landmarks, &keyframe.digest}) move(*part);
  }
  for (MapIndex::FrameEntry& frame : index.frames) {
    if (frame.own)
      frame.images = index.keyframes[static_cast<size_t>(frame.keyframe)].images;
    else
      move(frame.images);
  }
  parts.finish(index);
}

}  // namespace

MapJournal::MapJournal(const fs::path& target, Warn warn)
    : folder_(target, kJournalSuffix), warn_(std::move(warn)), parts_(folder_.path() / kMapFile) {
  thread_ = std::thread([this] { work(); });
}

MapJournal::~MapJournal() {
  stop();
  if (!removed_ && saved_keyframes_ == 0) folder_.remove();
}

void MapJournal::stop() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

int MapJournal::saved_keyframes() const {
  const std::lock_guard lock(mutex_);
  return saved_keyframes_;
}

void MapJournal::update(const KeyframeMap& map) {
  std::vector<Step> steps;
  if (!std::exchange(begun_, true)) steps = begin(map);
  if (map.revision() != revision_) note_changes(map, steps);
  note_additions(map, steps);
  if (steps.empty()) return;
  {
    const std::lock_guard lock(mutex_);
    waiting_.insert(waiting_.end(), std::make_move_iterator(steps.begin()), std::make_move_iterator(steps.end()));
  }
  changed_.notify_all();
}

std::vector<MapJournal::Step> MapJournal::begin(const KeyframeMap& map) {
  revision_ = map.revision();
  base_ = map.source();
  return {[this, camera = numbers_of(map.rig().camera), base = base_] {
    index_.camera = camera;
    layout_.emplace(index_.image_size());
    std::error_code ignored;
    fs::remove(folder_.path() / kBaseFile, ignored);  // of an attempt that failed
    if (base) link_base(*base->file, folder_.path() / kBaseFile);
  }};
}

std::optional<StoredPart> MapJournal::part_of_base(const StoredFrame& frame) const {
  const std::optional<uint64_t> offset = base_ ? base_->file->offset_of(frame.depth_m.data) : std::nullopt;
  if (!offset || !frame.check) return std::nullopt;
  StoredPart part;
  part.offset = *offset;
  part.checksum = frame.check->checksum();
  part.file = kBase;
  return part;
}

// Called by steps.
StoredPart MapJournal::saved(const StoredFrame& frame) {
  std::optional<StoredPart> part = part_of_base(frame);
  if (!part) return parts_.add(frame, *layout_);
  part->size = layout_->bytes;
  return *part;
}

// Called after each step: copies the last corrections to the entries that the index has so far. There is one copy of them,
// however many steps wait while the disk is full.
void MapJournal::bring_up_to_date() {
  std::shared_ptr<const Present> present;
  {
    const std::lock_guard lock(mutex_);
    if (images_to_replace_ > 0) return;  // the corrections belong to the new images
    present = present_;
  }
  if (!present) return;
  if (std::exchange(applied_, present) != present) applied_links_ = applied_keyframes_ = applied_frames_ = 0;
  for (size_t& i = applied_links_; i < std::min(present->links.size(), index_.links.size()); ++i)
    index_.links[i] = present->links[i];
  for (size_t& i = applied_keyframes_; i < std::min(present->keyframes.size(), index_.keyframes.size()); ++i)
    std::tie(index_.keyframes[i].world_from_camera, index_.keyframes[i].motion) = present->keyframes[i];
  for (size_t& i = applied_frames_; i < std::min(present->frames.size(), index_.frames.size()); ++i)
    index_.frames[i].keyframe_from_camera = present->frames[i];
}

// Poses, motions, links and frames that were noted before.
void MapJournal::note_changes(const KeyframeMap& map, std::vector<Step>& steps) {
  revision_ = map.revision();
  int replaced = 0;
  for (size_t i = 0; i < images_.size(); ++i) {
    const StoredFrame& frame = map.keyframes()[i].frame;
    if (std::exchange(images_[i], frame.depth_m.data) == frame.depth_m.data) continue;
    ++replaced;
    steps.push_back([this, i, frame, landmarks = map.keyframes()[i].landmarks.get()] {
      const StoredPart part = saved(frame);
      const StoredPart of_landmarks = parts_.add(landmark_bytes(*landmarks)),
                       of_digest = parts_.add(digest_bytes(digest_of(*landmarks)));
      index_.keyframes[i].images = part;
      index_.keyframes[i].landmarks = of_landmarks;
      index_.keyframes[i].digest = of_digest;
      for (MapIndex::FrameEntry& entry : index_.frames) {
        if (entry.own && entry.keyframe == static_cast<int>(i)) entry.images = part;
      }
      const std::lock_guard lock(mutex_);
      --images_to_replace_;
    });
  }
  auto present = std::make_shared<Present>();
  present->links.assign(map.links().begin(), map.links().end());
  for (const Keyframe& keyframe : map.keyframes())
    present->keyframes.emplace_back(keyframe.world_from_camera, keyframe.motion);
  for (const MapFrame& frame : map.frames()) present->frames.push_back(frame.keyframe_from_camera);
  {
    const std::lock_guard lock(mutex_);
    present_ = std::move(present);
    images_to_replace_ += replaced;
  }
  steps.emplace_back([] {});
}

void MapJournal::note_additions(const KeyframeMap& map, std::vector<Step>& steps) {
  for (size_t i = images_.size(); i < map.keyframes().size(); ++i) {
    const Keyframe& keyframe = map.keyframes()[i];
    MapIndex::KeyframeEntry entry{
        keyframe.index, keyframe.timestamp_s, keyframe.world_from_camera, keyframe.motion, {}, {}, {}};
    images_.push_back(keyframe.frame.depth_m.data);
    if (base_ && i < base_->keyframes.size())
      steps.push_back([this, entry, frame = keyframe.frame, known = base_->keyframes[i]]() mutable {
        entry.images = saved(frame);
        entry.landmarks = {known.landmarks, kBase};
        entry.digest = {known.digest, kBase};
        index_.keyframes.push_back(entry);
      });
    else
      steps.push_back([this, entry, frame = keyframe.frame, landmarks = keyframe.landmarks.get()]() mutable {
        entry.images = saved(frame);
        entry.landmarks = parts_.add(landmark_bytes(*landmarks));
        entry.digest = parts_.add(digest_bytes(digest_of(*landmarks)));
        index_.keyframes.push_back(entry);
      });
  }
  for (; frames_ < map.frames().size(); ++frames_) {
    const MapFrame& added = map.frames()[frames_];
    MapIndex::FrameEntry entry{
        added.keyframe, added.keyframe_from_camera, added.frame.index, added.frame.timestamp_s, {}, false};
    entry.own = added.frame.depth_m.data == map.keyframes()[static_cast<size_t>(added.keyframe)].frame.depth_m.data;
    if (entry.own)
      steps.push_back([this, entry]() mutable {
        entry.images = index_.keyframes[static_cast<size_t>(entry.keyframe)].images;
        index_.frames.push_back(entry);
      });
    else
      steps.push_back([this, entry, frame = added.frame]() mutable {
        entry.images = saved(frame);
        index_.frames.push_back(entry);
      });
  }
  if (links_ == map.links().size()) return;
  std::vector<PoseEdge> links(map.links().begin() + static_cast<std::ptrdiff_t>(links_), map.links().end());
  links_ = map.links().size();
  steps.push_back(
      [this, links = std::move(links)] { index_.links.insert(index_.links.end(), links.begin(), links.end()); });
}

void MapJournal::work() {
  const SerialLoops serial;  // the other cores belong to the other threads
  std::unique_lock lock(mutex_);
  for (;;) {
    // After a failure, it tries again.
    changed_.wait(lock, [&] { return stopping_ || !waiting_.empty() || !failure_.empty(); });
    const bool last = stopping_;
    steps_.insert(steps_.end(), std::make_move_iterator(waiting_.begin()), std::make_move_iterator(waiting_.end()));
    waiting_.clear();
    lock.unlock();
    save();
    if (!failure_.empty() && !last && !std::exchange(warned_, true))
      warn_(failure_ + "; mapping goes on, and the map of " + std::to_string(saved_keyframes()) +
            " keyframes is saved so far");
    lock.lock();
    if (last) return;
    changed_.wait_for(lock, kInterval, [&] { return stopping_; });
  }
}

void MapJournal::save() {
  const auto attempt = [&](const auto& part) {
    try {
      part();
    } catch (const std::exception& e) {
      failure_ = e.what();
    }
  };
  failure_.clear();
  attempt([&] {
    for (; !steps_.empty(); steps_.pop_front()) {
      const uint64_t end = parts_.end();
      try {
        steps_.front()();
        bring_up_to_date();
      } catch (...) {
        parts_.go_back(end);
        throw;
      }
      index_is_new_ = true;
    }
  });
  attempt([&] { write_index(); });
}

void MapJournal::write_index() {
  if (!index_is_new_ || index_.keyframes.empty()) return;
  parts_.sync();
  StagedFile file(folder_.path() / kIndexFile);
  write_text(file.path(), index_bytes(index_, parts_.end()));
  file.commit();
  index_is_new_ = false;
  const std::lock_guard lock(mutex_);
  saved_keyframes_ = static_cast<int>(index_.keyframes.size());
}

void MapJournal::finish(const KeyframeMap& map, const fs::path& file) {
  update(map);
  stop();
  if (!failure_.empty()) save();  // perhaps there is space again
  if (!failure_.empty()) throw Error(failure_);
  complete(index_, parts_, base_ ? base_->file.get() : nullptr);
  link_input(folder_.path() / kMapFile, file, kMostMapBytes);
}

void MapJournal::remove() {
  stop();
  folder_.remove();
  removed_ = true;
}

std::vector<LeftMap> left_maps(const fs::path& given) {
  fs::path target = given;
  while (target.filename().empty() && target.has_relative_path()) target = target.parent_path();
  std::vector<LeftMap> left;
  for (const fs::path& folder : WorkFolder::left(target, kJournalSuffix)) {
    try {
      if (!fs::exists(folder / kIndexFile) || is_same_file(folder / kMapFile, target / kMapFile)) {
        WorkFolder::taken_over(folder).remove();
        continue;
      }
    } catch (const Error&) {
      continue;  // another process was faster
    }
    LeftMap map{folder, 0, folder.string()};
    try {
      map.keyframes = static_cast<int>(read_journal_index(folder).index.keyframes.size());
      map.message += ": contains the map of a run that ended early, " + std::to_string(map.keyframes) +
                     " keyframes; restore it with `fringeslam map recover " + shell_word(target.string()) + "`";
    } catch (const Error& e) {
      map.message = std::string(e.what()) + "; it belongs to a run that ended early";
    }
    left.push_back(std::move(map));
  }
  return left;
}

RecoveredMap recover_map(const WorkFolder& journal, const fs::path& file) {
  const fs::path own_file = journal.path() / kMapFile;
  const std::string where = own_file.string();
  MapIndex index = read_journal_index(journal.path()).index;
  const FrameLayout layout(index.image_size());
  std::shared_ptr<const MappedFile> memory[kFiles] = {map_into_memory(own_file), nullptr};
  const auto file_of = [&](const StoredPart& part) -> const MappedFile& {
    std::shared_ptr<const MappedFile>& mapped = memory[part.file];
    if (!mapped) mapped = map_into_memory(journal.path() / kBaseFile);
    return *mapped;
  };
  const auto is_there = [&](const StoredPart& part) { return part.offset + part.size <= file_of(part).bytes().size(); };
  const auto is_whole_frame = [&](const StoredPart& part) {
    if (!is_there(part)) return false;
    const MappedFile& mapped = file_of(part);
    const bool same = checksum_of(frame_in_file(mapped, part, layout, where)) == part.checksum;
    mapped.release();
    return same;
  };
  const auto has_landmarks = [&](const MapIndex::KeyframeEntry& keyframe) {
    try {
      if (!is_there(keyframe.landmarks) || !is_there(keyframe.digest)) return false;
      const LandmarkCounts expected(read_digest(file_of(keyframe.digest), keyframe.digest, where));
      (void)read_landmarks(file_of(keyframe.landmarks), keyframe.landmarks, expected, where);
      return true;
    } catch (const Error&) {
      return false;
    }
  };
  const size_t all = index.keyframes.size() + index.frames.size();
  size_t whole = 0;
  while (whole < index.keyframes.size() && is_whole_frame(index.keyframes[whole].images) &&
         has_landmarks(index.keyframes[whole]))
    ++whole;
  if (whole == 0) throw Error(journal.path().string() + ": contains no complete keyframe; create the map again");
  index.keyframes.resize(whole);
  const auto beyond = [&](int keyframe) { return keyframe >= static_cast<int>(whole); };
  std::erase_if(index.frames, [&](const MapIndex::FrameEntry& frame) {
    return beyond(frame.keyframe) || (!frame.own && !is_whole_frame(frame.images));
  });
  std::erase_if(index.links, [&](const PoseEdge& link) { return beyond(link.from) || beyond(link.to); });

  // Bytes behind the last part in use are overwritten; the index of the journal does not need them.
  uint64_t end = kMapAlignment;
  const auto include = [&](const StoredPart& part) {
    if (part.file == kOwn) end = std::max(end, aligned(part.offset + part.size));
  };
  for (const MapIndex::KeyframeEntry& keyframe : index.keyframes) {
    for (const StoredPart* const part : {&keyframe.images, &keyframe.landmarks, &keyframe.digest}) include(*part);
  }
  for (const MapIndex::FrameEntry& frame : index.frames) include(frame.images);
  MapParts parts(own_file, end);
  complete(index, parts, memory[kBase].get());
  link_input(own_file, file, kMostMapBytes);
  const auto count = [](size_t items) { return static_cast<int>(items); };
  return {count(whole), count(index.frames.size()), count(index.links.size()),
          count(all - whole - index.frames.size())};
}

}  // namespace fringeslam

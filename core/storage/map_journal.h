// SPDX-License-Identifier: Apache-2.0
// Saves a map while it grows, so that a crash loses at most the last second of mapping.
//
// The journal is a folder NAME.mapping-XXXXXX beside the result NAME (WorkFolder in core/io/staged.h):
//
//   saved.map   parts of a map file (map_index.h): images and landmarks, appended as they enter the map
//   index       the index of the map so far, small, with the present poses; replaced in one step, at most every 0.4 s
//   base.map    a link to the map that the mission continues, whose parts are not copied until the end
//
// Parts reach the disk before the index that names them, so the index on the disk is always that of a complete map. A thread
// of its own writes; the images that wait are those of the map, which take no further memory.
#pragma once

#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/io/staged.h"
#include "core/map/keyframe_map.h"
#include "core/storage/map_index.h"
#include "core/storage/map_parts.h"

namespace fringeslam {

class MapJournal {
 public:
  // Receives one line, in another thread, when the map cannot be saved for the first time.
  using Warn = std::function<void(const std::string& message)>;

  // Creates the folder beside `target`. Throws Error if that fails.
  MapJournal(const std::filesystem::path& target, Warn warn);
  // Saves what it was given and ends. The folder remains, unless remove() was called or it contains no keyframe.
  ~MapJournal();
  MapJournal(const MapJournal&) = delete;
  MapJournal& operator=(const MapJournal&) = delete;

  // Notes what has changed in the map, to be saved within a second. Takes time only for what is new.
  void update(const KeyframeMap& map);
  // Saves the final map and makes it appear as `file`, which must not exist. The same sequence of maps gives the same bytes.
  // Throws Error if it cannot be saved.
  void finish(const KeyframeMap& map, const std::filesystem::path& file);
  // Removes the folder, once the map is safe elsewhere.
  void remove();

  const std::filesystem::path& folder() const { return folder_.path(); }
  // Number of keyframes on the disk.
  int saved_keyframes() const;

 private:
  // Appends at most the parts of one frame or keyframe, then changes the index.
  using Step = std::function<void()>;

  // The parts of the map that corrections change.
  struct Present {
    std::vector<std::pair<Pose, KeyframeMotion>> keyframes;
    std::vector<Pose> frames;
    std::vector<PoseEdge> links;
  };

  std::vector<Step> begin(const KeyframeMap& map);
  void note_changes(const KeyframeMap& map, std::vector<Step>& steps);
  void note_additions(const KeyframeMap& map, std::vector<Step>& steps);
  std::optional<StoredPart> part_of_base(const StoredFrame& frame) const;
  StoredPart saved(const StoredFrame& frame);
  void bring_up_to_date();
  void work();
  void save();
  void write_index();
  void stop();

  WorkFolder folder_;
  Warn warn_;

  // Used by the thread that calls update(): the map that is continued, and the parts noted so far.
  std::shared_ptr<const MapSource> base_;
  bool begun_ = false;
  int revision_ = 0;
  std::vector<const uchar*> images_;  // the depth of each keyframe
  size_t frames_ = 0, links_ = 0;

  // Used by the thread that writes.
  MapIndex index_;
  std::optional<FrameLayout> layout_;
  MapParts parts_;
  std::deque<Step> steps_;
  bool index_is_new_ = false, warned_ = false;
  std::string failure_;  // of the last attempt
  // The last corrections in the index, and how many of its entries have them.
  std::shared_ptr<const Present> applied_;
  size_t applied_links_ = 0, applied_keyframes_ = 0, applied_frames_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Step> waiting_;               // guarded by mutex_
  std::shared_ptr<const Present> present_;  // at the last correction; guarded by mutex_
  int images_to_replace_ = 0;  // steps that wait, without which present_ does not describe the index; guarded by mutex_
  bool stopping_ = false;      // guarded by mutex_
  int saved_keyframes_ = 0;    // guarded by mutex_

  bool removed_ = false;
  std::thread thread_;
};

// A journal that a process left when it died.
struct LeftMap {
  std::filesystem::path folder;
  int keyframes = 0;    // 0: its index is damaged
  std::string message;  // one line: what was found and how to recover it
};
// Finds the journals of the result `target`; removes those without any keyframe, or whose map is part of the result.
std::vector<LeftMap> left_maps(const std::filesystem::path& target);

struct RecoveredMap {
  int keyframes = 0, frames = 0, links = 0;
  int damaged = 0;  // keyframes and frames left out because they, or a keyframe before them, are damaged
};
// Writes the map of a journal to `file`, which must not exist. Checks all parts; the map ends before the first damaged keyframe.
// The journal remains. Throws Error if it is in use or contains no complete keyframe.
RecoveredMap recover_map(const WorkFolder& journal, const std::filesystem::path& file);

// Suffix of the names of journals' folders.
constexpr const char* kJournalSuffix = "mapping";

}  // namespace fringeslam

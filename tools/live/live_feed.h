// SPDX-License-Identifier: Apache-2.0
// The live page's state of a capture or run. The mapping side hands views over and never waits longer than it takes to
// copy what is new; each viewer polls at its own pace for everything that changed since a sequence number it received
// earlier. There are no queues: late or slow viewers get more in one answer, and memory grows with the map, not with
// the number of viewers.
//
// changes() returns a JSON object. A viewer that keeps `views` and `keyframes` as lists and replaces their ends by
// what arrives ends up with the same state as one that asks for everything:
//
//   run         a different value is a different run: start over
//   sequence    pass this in the next request
//   finished    nothing more will come
//   dropped, views_per_s
//   about       only in the first answer: verb, name, expected stacks (0: unknown), rig, maps, image corners as rays
//               (x, y, 1), robot_from_camera
//   views       {from, list}: index, timestamp_s and, for a mapped view, tracking, relocalized, number of loops closed,
//               whether the map was corrected then, robot pose in the world frame
//   keyframes   {from, list}: camera pose in the world frame, landmarks (positions in the camera's frame)
//   newest      number, index, figures and warnings of the newest view, outlines of its landmarks
//   candidates  warm regions: position_m (world frame), radius_m, state, reason, and whether it may be a victim
//
// Poses are x y z qx qy qz qw; after a map correction all views and keyframes are sent again with new poses.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/mapper/pipeline.h"
#include "tools/live/live_view.h"

namespace fringeslam::tools {

struct LiveSetup {
  std::string verb;  // capture, focus or run
  std::string name;  // of the capture or run
  RigModel rig;
  PatternSequence sequence;
  int stacks = 0;     // expected; 0: unknown
  bool maps = false;  // views come with poses and a map
};

// Mark of a warm thing (core/thermal/victims.h) on the live page.
struct WarmObjectMark {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // world frame
  double radius_m = 0;
  std::string state;   // "seen once", "confirmed", …
  std::string reason;  // human-readable
  bool victim = true;  // may be a victim
};

class LiveFeed {
 public:
  explicit LiveFeed(LiveSetup setup);

  // For the capturing or mapping side. The stacks' images are shared and must not change.
  void show(const FringeStack& stack);
  // Adds a stack with its result. `trajectory` returns all tracked views and is called when the map was corrected;
  // `dropped` counts the stacks so far that were not mapped because mapping lagged behind. Returns true if views shown before
  // have moved.
  bool show(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map,
            const std::function<Trajectory()>& trajectory, int dropped);
  void show_candidates(std::vector<WarmObjectMark> candidates);
  void finish();

  // For viewers.
  std::string changes(const std::string& run, uint64_t since) const;
  std::string snapshot() const { return changes(run_, 0); }
  // Waits until something is newer than `since`, `give_up` (polled) returns true, or the time is up.
  void await_change(const std::string& run, uint64_t since, std::chrono::milliseconds longest,
                    const std::function<bool()>& give_up) const;
  // Returns one of the last views reported by changes(); null for others. had_view is true if it ever existed.
  std::shared_ptr<const LiveView> view(int number) const;
  bool had_view(int number) const;
  // keyframe_points.h; the last ones computed are kept.
  std::optional<std::string> points_of(int keyframe) const;

  const LiveSetup& setup() const { return setup_; }
  size_t views_kept() const;

 private:
  struct SeenView {
    uint64_t sequence = 0;
    int index = 0;
    double timestamp_s = 0;
    std::optional<Tracking> tracking;
    bool relocalized = false;
    int loops = 0;
    bool corrected = false;
    std::optional<Pose> world_from_robot;
    int images = 0;
    std::optional<CameraMotion> motion;  // during the stack
  };
  struct SeenKeyframe {
    uint64_t sequence = 0;
    Pose world_from_camera;
    std::vector<Eigen::Vector3d> landmarks_m;
    StoredFrame frame;  // shared with the map
    int version = 0;    // of the frame
  };
  struct Changes;
  using Clock = std::chrono::steady_clock;

  void add(SeenView seen, std::shared_ptr<const LiveView> view);  // with the lock held
  bool take_keyframes(const KeyframeMap& map);
  void take_corrections(const KeyframeMap& map, const Trajectory& trajectory);
  std::vector<std::string> motion_warnings(const FrameResult& result);
  Changes changed_since(uint64_t since) const;

  const LiveSetup setup_;
  const std::string run_;
  std::once_flag triangulated_;  // by a capture's first viewer
  std::optional<Triangulation> triangulation_;

  mutable std::mutex mutex_;  // guards all members below; held only while copying
  mutable std::condition_variable changed_;
  uint64_t sequence_ = 0, candidates_at_ = 0;
  std::vector<SeenView> views_;
  std::vector<SeenKeyframe> keyframes_;
  std::vector<WarmObjectMark> candidates_;
  std::shared_ptr<const LiveView> newest_;
  mutable std::deque<std::shared_ptr<const LiveView>> reported_;
  std::deque<Clock::time_point> times_;
  PixelRays rays_;
  int dropped_ = 0;
  bool finished_ = false;
  mutable std::deque<std::pair<int, std::string>> points_;  // by keyframe, the latest last
};

}  // namespace fringeslam::tools

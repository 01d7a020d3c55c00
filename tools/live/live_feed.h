// SPDX-License-Identifier: Apache-2.0
// What the live page knows of a capture or a run. The side that maps hands views over and never waits for more than a
// copy of what is new; the viewers' side asks, each at its own pace, for all that changed since a sequence number that
// it was told before. So there is no queue: who comes late or falls behind is told more at once, and memory grows with
// the map, not with viewers.
//
// changes() is a JSON object; a viewer that keeps `views` and `keyframes` as lists and replaces their ends by what
// comes has the same as one who asks for everything:
//
//   run         another one is another run: start anew
//   sequence    to ask from the next time
//   finished    no more will come
//   dropped, views_per_s
//   about       only in the first answer: verb, name, stacks expected (0: unknown), rig, maps, corners of the image as
//               rays (x, y, 1), robot_from_camera
//   views       {from, list}: index, timestamp_s, and of a run tracking, found_again, loops that it closed, whether the
//   map
//               was corrected then, pose (of the robot, in the world)
//   keyframes   {from, list}: pose (of the camera, in the world), landmarks (positions in its frame)
//   newest      number, index, figures and warnings of the newest view, landmarks outlined in it
//   candidates  warm places: position_m (in the world), radius_m, state, reason, and whether there may be a victim
//
// Poses are x y z qx qy qz qw; those of all views and keyframes come anew when the map was corrected.
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
#include <vector>

#include "core/mapper/pipeline.h"
#include "tools/live/live_view.h"

namespace fringeslam::tools {

struct LiveSetup {
  std::string verb;  // capture, focus or run
  std::string name;  // of what is captured or mapped
  RigModel rig;
  PatternSequence sequence;
  int stacks = 0;       // expected; 0: unknown
  bool maps = false;    // views come with poses and a map
  bool moving = false;  // the robot moves while a sequence is taken
};

// Of the thermal channel: a warm place, whether it may hold a victim, and why.
struct VictimCandidate {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // in the world
  double radius_m = 0;
  std::string state;   // "seen once", "confirmed", …
  std::string reason;  // for a person to read
  bool victim = true;  // may be one
};

class LiveFeed {
 public:
  explicit LiveFeed(LiveSetup setup);

  // Of the side that captures or maps. Images of stacks are shared and must not change.
  void show(const FringeStack& stack);
  // And what was made of it. `trajectory`: of all tracked views, asked for when the map was corrected; `dropped`:
  // stacks so far that were never mapped because mapping was behind.
  void show(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map,
            const std::function<Trajectory()>& trajectory, int dropped);
  void show_candidates(std::vector<VictimCandidate> candidates);
  void finish();

  // Of viewers.
  std::string changes(const std::string& run, uint64_t since) const;
  std::string snapshot() const { return changes(run_, 0); }
  // Until something is newer than `since`, `give_up` says so (asked now and then) or the time is over.
  void await_change(const std::string& run, uint64_t since, std::chrono::milliseconds longest,
                    const std::function<bool()>& give_up) const;
  // One of the last that changes() told of; null for others. And whether there ever was such a view.
  std::shared_ptr<const LiveView> view(int number) const;
  bool had_view(int number) const;
  std::optional<std::string> points_of(int keyframe) const;  // keyframe_points.h

  const LiveSetup& setup() const { return setup_; }
  size_t views_kept() const;

 private:
  struct SeenView {
    uint64_t sequence = 0;
    int index = 0;
    double timestamp_s = 0;
    std::optional<Tracking> tracking;
    bool found_again = false;
    int loops = 0;
    bool corrected = false;
    std::optional<Pose> world_from_robot;
  };
  struct SeenKeyframe {
    uint64_t sequence = 0;
    Pose world_from_camera;
    std::vector<Eigen::Vector3d> landmarks_m;
    StoredFrame frame;  // shared with the map
  };
  struct Changes;
  using Clock = std::chrono::steady_clock;

  void add(SeenView seen, std::shared_ptr<const LiveView> view);  // with the lock held
  void take_keyframes(const KeyframeMap& map);
  void take_corrections(const KeyframeMap& map, const Trajectory& trajectory);
  std::vector<std::string> motion_warnings(const FrameResult& result, double timestamp_s);
  Changes changed_since(uint64_t since) const;

  const LiveSetup setup_;
  const std::string run_;
  std::optional<double> last_tracked_s_;  // of the side that maps alone
  std::once_flag triangulated_;           // by the first viewer of a capture
  std::optional<Triangulation> triangulation_;

  mutable std::mutex mutex_;  // of what follows; held for no longer than copies take
  mutable std::condition_variable changed_;
  uint64_t sequence_ = 0, candidates_at_ = 0;
  std::vector<SeenView> views_;
  std::vector<SeenKeyframe> keyframes_;
  std::vector<VictimCandidate> candidates_;
  std::shared_ptr<const LiveView> newest_;
  mutable std::deque<std::shared_ptr<const LiveView>> told_;
  std::deque<Clock::time_point> times_;
  PixelRays rays_;
  int dropped_ = 0;
  bool finished_ = false;
};

}  // namespace fringeslam::tools

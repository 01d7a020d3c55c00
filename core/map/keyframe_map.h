// SPDX-License-Identifier: Apache-2.0
// The map (docs/method.md, section 8.1): keyframes, joined by measured motions into a pose graph, and the frames taken
// between them, each fixed to a keyframe. When a loop is closed, the keyframes move and their frames move with them.
// Cloud and surface are fused from the frames on request.
//
// Only views that show something new are kept, so a stationary robot does not fill the memory. Frames are kept in a file
// without a name (frame_memory.h), so a long path does not fill it either.
#pragma once

#include <optional>
#include <vector>

#include "core/map/frame_memory.h"
#include "core/map/map_source.h"
#include "core/map/pose_graph.h"
#include "core/map/stored_frame.h"
#include "core/types/known_landmarks.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct MappingOptions {
  double min_view_change = 0.05;
  double keyframe_overlap = 0.7;
  double min_loop_overlap = 0.3;
  int max_links = 4;
  double significant_m = 5e-5;
  bool every_view = false;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("min_view_change", min_view_change, {0, 10},
            "least difference from all views in the map for a view to be added, image widths");
    v.field("keyframe_overlap", keyframe_overlap, {0, 1},
            "overlap with its keyframe below which a view becomes a new keyframe");
    v.field("min_loop_overlap", min_loop_overlap, {0, 1}, "least expected overlap for registering two keyframes");
    v.field("significant_m", significant_m, {0, 1},
            "displacement of a surface above which the map counts as corrected, m");
    v.field("max_links", max_links, {0, 1000},
            "largest number of earlier keyframes that a new one is registered with, besides its own");
    v.field("every_view", every_view, "every view that is registered by depth becomes a keyframe");
  }
};

// How the uncertain motion of the camera during a keyframe's stack affects its frame.
struct KeyframeMotion {
  Matrix6d covariance = Matrix6d::Zero();  // of the surface's pose in the keyframe's camera, tangent of retract()
  // The frame may be distorted, or lie elsewhere than the landmarks: these alone do not determine a pose relative to it.
  bool doubtful = false;
};

struct Keyframe {
  int index = 0;  // stack index
  double timestamp_s = 0;
  Pose world_from_camera;
  KnownLandmarks landmarks;
  StoredFrame frame;
  KeyframeMotion motion = {};
};

// Returns the covariance that the uncertain motion during a keyframe's stack adds to the pose of a view relative to it,
// tangent of retract() at keyframe_from_view (docs/method.md, section 9.4).
Matrix6d covariance_by_motion(const Keyframe& keyframe, const Pose& keyframe_from_view);
// Returns what the motions during both stacks add to the pose of a keyframe relative to another.
Matrix6d covariance_by_motion(const Keyframe& a, const Keyframe& b, const Pose& a_from_b);

// A frame that contributes points to the map; keyframes are included.
struct MapFrame {
  int keyframe = 0;
  Pose keyframe_from_camera;
  StoredFrame frame;
};

class KeyframeMap {
 public:
  KeyframeMap(const RigModel& rig, const MappingOptions& options);

  const std::vector<Keyframe>& keyframes() const { return keyframes_; }
  const std::vector<MapFrame>& frames() const { return frames_; }
  const std::vector<PoseEdge>& links() const { return links_; }
  const RigModel& rig() const { return rig_; }
  const PixelRays& rays() const { return rays_; }
  Frame keyframe_image(int keyframe) const;  // a keyframe's frame, restored
  // World pose of a view that is fixed to a keyframe.
  Pose world_from_camera(int keyframe, const Pose& keyframe_from_camera) const {
    return keyframes_[static_cast<size_t>(keyframe)].world_from_camera * keyframe_from_camera;
  }
  Pose world_from_camera(const MapFrame& frame) const {
    return world_from_camera(frame.keyframe, frame.keyframe_from_camera);
  }

  // Changes what is known of the motion during a keyframe's stack.
  void set_motion(int keyframe, const KeyframeMotion& motion);
  // Adds a keyframe and returns its number.
  int add_keyframe(const Frame& frame, Landmarks landmarks, const Pose& world_from_camera,
                   const KeyframeMotion& motion = {});
  // Replaces a keyframe's frame by a better reconstruction of the same view, in which the same surface lies elsewhere by
  // `new_from_old`. The keyframe keeps its pose; its links, its landmarks, the frames fixed to it and the other keyframes move with
  // the surface.
  void replace_frame(int keyframe, const Frame& frame, const Pose& new_from_old);
  // Adds the frame unless its view is too similar to any view in the map; returns whether it was added.
  bool add_frame(const Frame& frame, int keyframe, const Pose& keyframe_from_camera);

  // Adds a measured motion between the keyframes `link.from` and `link.to`, the later one. Its information, the inverse of a
  // covariance, need not be symmetric to the last digits.
  void link(const PoseEdge& link);
  // Changes whether a link may be rejected; `link` is its position in links().
  void set_loop(size_t link, bool loop);

  // Optimises the keyframe poses over all links; returns whether a point at mid range of any keyframe moved by more
  // than `significant_m`.
  bool correct(const PoseGraphOptions& options, double significant_m);

  // Bounds the covariance of the motion between two keyframes by the links of the shortest path between them. Zero if
  // `from` is `to`, and if no path of links determines the motion.
  Matrix6d covariance_between(int from, int to) const;

  // True if a path of at most `most` links, without the loops that disagree with the map, joins two keyframes.
  bool linked_within(int from, int to, int most) const;

  // Returns the share of a frame's points that lie on a surface seen by the keyframe, according to the poses.
  double expected_overlap(const Frame& frame, const Pose& world_from_camera, int keyframe) const;
  // Returns the keyframes with an expected overlap of at least min_loop_overlap, in descending order of overlap.
  std::vector<int> overlapping(const Frame& frame, const Pose& world_from_camera) const;

  // Mean displacement between two views of a few points at mid range, image widths.
  double view_change(const Pose& one_from_other) const;

  size_t memory_bytes() const;
  // Frames that were used since they were added need not stay in memory (frame_memory.h).
  void release_frames() const;

  // Replaces the content. The images stay where they are; if that is a file, `source` describes it.
  void restore(std::vector<Keyframe> keyframes, std::vector<MapFrame> frames, std::vector<PoseEdge> links,
               std::shared_ptr<const MapSource> source = {});
  // The file from which the map was opened, which contains its first keyframes; null: none.
  const std::shared_ptr<const MapSource>& source() const { return source_; }
  // Changes when poses, links or frames change that were in the map before; additions do not count.
  int revision() const { return revision_; }

 private:
  void move_descriptors(Landmarks& landmarks);
  bool disagrees(const PoseEdge& link) const;

  RigModel rig_;
  MappingOptions options_;
  PixelRays rays_;
  double largest_r2_;  // of the camera
  std::vector<Keyframe> keyframes_;
  std::vector<MapFrame> frames_;
  std::vector<PoseEdge> links_;
  std::vector<double> link_weights_;  // of the last correction
  size_t links_tested_ = 0;           // number of links when all loops were tested
  FrameMemory memory_;                // copies of the map share it
  std::shared_ptr<const MapSource> source_;
  int revision_ = 0;
};

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// What the robot has seen so far (METHOD S23): keyframes, joined by measured motions into a pose graph, and the frames
// that were taken between them, each fixed to its keyframe. When a loop is closed the keyframes move and their frames
// go with them. What is fused from frames, cloud and surface, is fused when it is asked for.
//
// Only views that show something new are kept: a robot that stays in one place fills no memory.
#pragma once

#include <optional>
#include <vector>

#include "core/map/cloud.h"
#include "core/map/pose_graph.h"
#include "core/map/stored_frame.h"
#include "core/types/landmark.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct MappingOptions {
  double min_view_change = 0.05;
  double keyframe_overlap = 0.7;
  double min_loop_overlap = 0.3;
  int max_links = 4;
  double significant_m = 5e-5;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("min_view_change", min_view_change, {0, 10},
            "by how much a view must differ from all in the map to join them, widths of the image");
    v.field("keyframe_overlap", keyframe_overlap, {0, 1},
            "share of a view that its keyframe sees too, below which it becomes a keyframe");
    v.field("min_loop_overlap", min_loop_overlap, {0, 1}, "expected share at which two keyframes are registered");
    v.field("significant_m", significant_m, {0, 1},
            "by how much a surface must move for the map to have been corrected, m");
    v.field("max_links", max_links, {0, 1000}, "earlier keyframes that a new one is registered with, beside its own");
  }
};

struct Keyframe {
  int index = 0;  // of the stack
  double timestamp_s = 0;
  Pose world_from_camera;
  Landmarks landmarks;
  StoredFrame frame;
};

// A frame whose points are the map's; keyframes are among them.
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
  Frame keyframe_image(int keyframe) const;  // restored
  // Of a view that is fixed to a keyframe.
  Pose world_from_camera(int keyframe, const Pose& keyframe_from_camera) const {
    return keyframes_[static_cast<size_t>(keyframe)].world_from_camera * keyframe_from_camera;
  }
  Pose world_from_camera(const MapFrame& frame) const {
    return world_from_camera(frame.keyframe, frame.keyframe_from_camera);
  }

  // The number of the new keyframe.
  int add_keyframe(const Frame& frame, Landmarks landmarks, const Pose& world_from_camera);
  // Keeps the frame if its view differs from those of the keyframe and its frames; whether it does.
  bool add_frame(const Frame& frame, int keyframe, const Pose& keyframe_from_camera);

  // `link.from` and `.to` are keyframes; the later one is `to`.
  void link(const PoseEdge& link) { links_.push_back(link); }

  // Poses of the keyframes that fit all links best. Whether a surface moved by more than `significant_m`.
  bool correct(const PoseGraphOptions& options, double significant_m);

  // Share of a frame's points that lie where the keyframe sees a surface too, if the poses are right.
  double expected_overlap(const Frame& frame, const Pose& world_from_camera, int keyframe) const;
  // Keyframes by it, the most first; those below min_loop_overlap are left out.
  std::vector<int> overlapping(const Frame& frame, const Pose& world_from_camera) const;

  CloudMap cloud(const CloudOptions& options) const;
  size_t memory_bytes() const;

  // As read from a file (map_file.h).
  void restore(std::vector<Keyframe> keyframes, std::vector<MapFrame> frames, std::vector<PoseEdge> links);

 private:
  double view_change(const Pose& one_from_other) const;

  RigModel rig_;
  MappingOptions options_;
  PixelRays rays_;
  std::vector<Keyframe> keyframes_;
  std::vector<MapFrame> frames_;
  std::vector<PoseEdge> links_;
};

}  // namespace fringeslam

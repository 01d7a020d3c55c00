// SPDX-License-Identifier: Apache-2.0
#include "core/map/keyframe_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

template <class List>
auto& at(List& list, int i) {
  return list[static_cast<size_t>(i)];
}

}  // namespace

Matrix6d covariance_by_motion(const Keyframe& keyframe, const Pose& keyframe_from_view) {
  // A shift of the keyframe's frame moves the pose from the left.
  const Matrix6d moved = tangent_of_product(keyframe_from_view.translation);
  return moved * keyframe.motion.covariance * moved.transpose();
}

Matrix6d covariance_by_motion(const Keyframe& a, const Keyframe& b, const Pose& a_from_b) {
  return covariance_by_motion(a, a_from_b) + rotated_covariance(a_from_b.rotation, b.motion.covariance);
}

KeyframeMap::KeyframeMap(const RigModel& rig, const MappingOptions& options)
    : rig_(rig), options_(options), rays_(pixel_rays(rig.camera)), largest_r2_(rig.camera.largest_r2()) {
  check_options(options, "mapping");
}

Frame KeyframeMap::keyframe_image(int keyframe) const { return restored(at(keyframes_, keyframe).frame, rays_); }

double KeyframeMap::view_change(const Pose& one_from_other) const {
  const double distance = rig_.middle_range_m(), half_width = 0.5 * rig_.camera.width / rig_.camera.fx;
  double change = 0;
  for (const double x : {-half_width, half_width}) {
    for (const double y : {-half_width, half_width}) {
      const Eigen::Vector3d point(distance * x, distance * y, distance);
      change += (one_from_other * point - point).norm() / (2 * half_width * distance) / 4;
    }
  }
  return change;
}

// Most of a keyframe's memory besides its images, and needed only where it is registered without a prediction.
void KeyframeMap::move_descriptors(Landmarks& landmarks) {
  cv::Mat1f& descriptors = landmarks.keypoints.descriptors;
  if (!descriptors.empty()) descriptors = memory_.moved(descriptors);
}

void KeyframeMap::link(const PoseEdge& link) {
  links_.push_back(link);
  links_.back().information = 0.5 * (link.information + link.information.transpose());
}

void KeyframeMap::set_loop(size_t link, bool loop) { at(links_, static_cast<int>(link)).loop = loop; }

void KeyframeMap::set_motion(int keyframe, const KeyframeMotion& motion) {
  at(keyframes_, keyframe).motion = motion;
  ++revision_;
}

int KeyframeMap::add_keyframe(const Frame& frame, Landmarks landmarks, const Pose& world_from_camera,
                              const KeyframeMotion& motion) {
  const int number = static_cast<int>(keyframes_.size());
  move_descriptors(landmarks);
  keyframes_.push_back(
      {frame.index, frame.timestamp_s, world_from_camera, std::move(landmarks), memory_.moved(stored(frame)), motion});
  frames_.push_back({number, {}, keyframes_.back().frame});  // shares the images
  return number;
}

void KeyframeMap::replace_frame(int keyframe, const Frame& frame, const Pose& new_from_old) {
  ++revision_;
  keyframes_[static_cast<size_t>(keyframe)].frame = memory_.moved(stored(frame));
  Landmarks landmarks = *keyframes_[static_cast<size_t>(keyframe)].landmarks.get();
  for (Keypoint& keypoint : landmarks.keypoints.keypoints) {
    keypoint.point_m = new_from_old * keypoint.point_m;
    keypoint.covariance_m2 = new_from_old.rotation * keypoint.covariance_m2 * new_from_old.rotation.transpose();
  }
  keyframes_[static_cast<size_t>(keyframe)].landmarks = std::move(landmarks);
  // The keyframe keeps its pose, so the rest of the map moves with the surface that it shows.
  const Pose& here = keyframes_[static_cast<size_t>(keyframe)].world_from_camera;
  const Pose moved = here * new_from_old * here.inverse();
  for (size_t i = 0; i < keyframes_.size(); ++i) {
    if (i != static_cast<size_t>(keyframe))
      keyframes_[i].world_from_camera = orthonormalised(moved * keyframes_[i].world_from_camera);
  }
  for (PoseEdge& link : links_) {
    if (link.from == keyframe) link.from_from_to = orthonormalised(new_from_old * link.from_from_to);
    if (link.to == keyframe) link.from_from_to = orthonormalised(link.from_from_to * new_from_old.inverse());
  }
  // A keyframe's own frame precedes the others that are fixed to it.
  bool own = true;
  for (MapFrame& fixed : frames_) {
    if (fixed.keyframe != keyframe) continue;
    if (std::exchange(own, false))
      fixed.frame = keyframes_[static_cast<size_t>(keyframe)].frame;
    else
      fixed.keyframe_from_camera = orthonormalised(new_from_old * fixed.keyframe_from_camera);
  }
}

bool KeyframeMap::add_frame(const Frame& frame, int keyframe, const Pose& keyframe_from_camera) {
  const Pose here = world_from_camera(keyframe, keyframe_from_camera);
  for (const MapFrame& known : frames_) {
    if (view_change(world_from_camera(known).inverse() * here) < options_.min_view_change) return false;
  }
  frames_.push_back({keyframe, keyframe_from_camera, memory_.moved(stored(frame))});
  return true;
}

bool KeyframeMap::correct(const PoseGraphOptions& options, double significant_m) {
  ++revision_;
  std::vector<Pose> poses;
  for (const Keyframe& keyframe : keyframes_) poses.push_back(keyframe.world_from_camera);
  // All loops are tested again whenever their number has grown by a quarter.
  const bool keep = 4 * links_.size() < 5 * links_tested_;
  const PoseGraphResult result = optimise_poses(poses, links_, options, keep ? link_weights_ : std::vector<double>());
  link_weights_ = result.converged ? result.weights : std::vector<double>();
  if (result.all_tested) links_tested_ = links_.size();
  const Eigen::Vector3d before(0, 0, rig_.middle_range_m());
  bool significant = false;
  for (size_t i = 0; i < poses.size(); ++i) {
    significant |= (result.poses[i] * before - poses[i] * before).norm() > significant_m;
    keyframes_[i].world_from_camera = orthonormalised(result.poses[i]);
  }
  return significant;
}

// A loop that the other links contradict, such as one to a place that looks the same.
bool KeyframeMap::disagrees(const PoseEdge& link) const {
  constexpr double kMostSquare = 36;
  if (!link.loop) return false;
  const Pose from_from_to =
      at(keyframes_, link.from).world_from_camera.inverse() * at(keyframes_, link.to).world_from_camera;
  const Vector6d residual = difference(from_from_to, link.from_from_to);
  return residual.dot(link.information * residual) > kMostSquare;
}

// The sigmas of the links are added, because their biases are correlated. A rotation error is multiplied by the remaining
// distance. Loops that disagree with the map are ignored.
Matrix6d KeyframeMap::covariance_between(int from, int to) const {
  constexpr double kLeastCondition = 1e-15;
  const auto pose = [&](int keyframe) { return at(keyframes_, keyframe).world_from_camera; };
  std::vector<std::vector<const PoseEdge*>> links(keyframes_.size());
  for (const PoseEdge& link : links_) {
    if (disagrees(link)) continue;
    at(links, link.from).push_back(&link);
    at(links, link.to).push_back(&link);
  }
  std::vector<const PoseEdge*> towards(keyframes_.size(), nullptr);  // the link that leads to `to`
  std::vector<int> reached = {to};
  for (size_t i = 0; i < reached.size() && at(towards, from) == nullptr; ++i) {
    for (const PoseEdge* link : at(links, reached[i])) {
      const int next = link->from == reached[i] ? link->to : link->from;
      if (next == to || at(towards, next) != nullptr) continue;
      at(towards, next) = link;
      reached.push_back(next);
    }
  }
  double turn_rad = 0, shift_m = 0;
  for (int here = from; here != to;) {
    const PoseEdge* link = at(towards, here);
    if (link == nullptr) return Matrix6d::Zero();
    const std::optional<Matrix6d> covariance = inverse_if_well_conditioned(link->information, kLeastCondition);
    if (!covariance) return Matrix6d::Zero();
    const double turn = std::sqrt(covariance->topLeftCorner<3, 3>().trace());
    turn_rad += turn;
    shift_m += std::sqrt(covariance->bottomRightCorner<3, 3>().trace()) +
               turn * (pose(here).translation - pose(to).translation).norm();
    here = link->from == here ? link->to : link->from;
  }
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(turn_rad * turn_rad), Eigen::Vector3d::Constant(shift_m * shift_m);
  return variances.asDiagonal();
}

bool KeyframeMap::linked_within(int from, int to, int most) const {
  if (from == to) return true;
  std::vector<const PoseEdge*> links;
  for (const PoseEdge& link : links_) {
    if (!disagrees(link)) links.push_back(&link);
  }
  std::vector<char> reached(keyframes_.size(), 0);
  at(reached, from) = 1;
  for (int length = 0; length < most && !at(reached, to); ++length) {
    std::vector<char> farther = reached;
    for (const PoseEdge* link : links) {
      if (at(reached, link->from) || at(reached, link->to)) at(farther, link->from) = at(farther, link->to) = 1;
    }
    reached = std::move(farther);
  }
  return at(reached, to);
}

double KeyframeMap::expected_overlap(const Frame& frame, const Pose& world_from_camera, int keyframe) const {
  constexpr int kEvery = 16;
  constexpr float kSameSurface_m = 0.03f;
  const Keyframe& other = at(keyframes_, keyframe);
  const Pose other_from_camera = other.world_from_camera.inverse() * world_from_camera;
  int points = 0, seen = 0;
  for (int row = kEvery / 2; row < frame.height(); row += kEvery) {
    for (int col = kEvery / 2; col < frame.width(); col += kEvery) {
      if (!frame.valid(row, col)) continue;
      ++points;
      const cv::Vec3f& p = frame.points_m(row, col);
      const Eigen::Vector3d point = other_from_camera * Eigen::Vector3d(p[0], p[1], p[2]);
      Eigen::Vector2d pixel;
      if (!rig_.camera.shows(point, largest_r2_, pixel)) continue;
      const float depth = other.frame.depth_m(static_cast<int>(pixel.y() + 0.5), static_cast<int>(pixel.x() + 0.5));
      seen += std::abs(depth - static_cast<float>(point.z())) < kSameSurface_m;
    }
  }
  return static_cast<double>(seen) / std::max(1, points);
}

std::vector<int> KeyframeMap::overlapping(const Frame& frame, const Pose& world_from_camera) const {
  std::vector<std::pair<double, int>> shares;
  for (int i = 0; i < static_cast<int>(keyframes_.size()); ++i) {
    // Views farther apart overlap hardly at all; skipping them saves time.
    if (view_change(at(keyframes_, i).world_from_camera.inverse() * world_from_camera) > 1.5) continue;
    const double share = expected_overlap(frame, world_from_camera, i);
    if (share >= options_.min_loop_overlap) shares.emplace_back(-share, i);
  }
  std::sort(shares.begin(), shares.end());
  std::vector<int> numbers;
  for (const auto& [share, number] : shares) numbers.push_back(number);
  return numbers;
}

size_t KeyframeMap::memory_bytes() const {
  size_t bytes = 0;
  for (const MapFrame& frame : frames_) bytes += bytes_of(frame.frame);
  for (const Keyframe& keyframe : keyframes_) bytes += keyframe.landmarks.memory_bytes();
  return bytes;
}

void KeyframeMap::release_frames() const {
  memory_.release();
  if (source_) source_->file->release();
}

void KeyframeMap::restore(std::vector<Keyframe> keyframes, std::vector<MapFrame> frames, std::vector<PoseEdge> links,
                          std::shared_ptr<const MapSource> source) {
  keyframes_ = std::move(keyframes);
  frames_ = std::move(frames);
  links_ = std::move(links);
  link_weights_.clear();
  links_tested_ = 0;
  source_ = std::move(source);
  ++revision_;
}

}  // namespace fringeslam

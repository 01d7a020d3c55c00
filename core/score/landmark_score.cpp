// SPDX-License-Identifier: Apache-2.0
#include "core/score/landmark_score.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>

namespace fringeslam {

namespace {

constexpr int kRecognised = 4;  // "more than 3 correct matches"

struct TruePoint {
  Eigen::Vector3d world = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  double depth_m = 0;
  int object = 0;
};

cv::Point nearest_pixel(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

bool within(const cv::Mat& image, const cv::Point& p) {
  return p.x >= 0 && p.y >= 0 && p.x < image.cols && p.y < image.rows;
}

// Intersects the ray of a sub-pixel position with the tangent plane of the surface seen by its pixel.
TruePoint true_point(const ScoredView& view, const Eigen::Vector2d& pixel, const Pinhole& camera) {
  TruePoint result;
  const cv::Point p = nearest_pixel(pixel);
  if (!within(view.truth->depth_m, p)) return result;
  const double z = view.truth->depth_m(p);
  if (!(z > 0)) return result;
  const cv::Vec3f n = view.truth->normals(p);
  const Eigen::Vector3d normal(n[0], n[1], n[2]);
  const Eigen::Vector3d centre = camera.undistort({p.x, p.y}).homogeneous();
  const Eigen::Vector3d ray = camera.undistort(pixel).homogeneous();
  const double facing = normal.dot(ray);
  const double depth = std::abs(facing) > 0.1 ? z * normal.dot(centre) / facing : z;
  result.world = view.world_from_camera * (depth * ray);
  result.depth_m = depth;
  result.object = static_cast<int>(view.truth->object_id(p));
  return result;
}

double sigma_of(const Keypoint& k) { return std::sqrt(k.covariance_m2.trace()); }

// Finds the pixel of the view that a world point projects to; false if the point is not visible or not directly lit.
bool shows(const ScoredView& view, const Eigen::Vector3d& world, const Pinhole& camera, cv::Point& pixel) {
  const Eigen::Vector3d point = view.world_from_camera.inverse() * world;
  if (!(point.z() > 0)) return false;
  pixel = nearest_pixel(camera.project(point));
  if (!within(view.truth->depth_m, pixel)) return false;
  const int mask = static_cast<int>(view.truth->mask(pixel));
  if (!(mask & kTruthSurface) || !(mask & kTruthInBeam) || (mask & kTruthInShadow)) return false;
  // An occluding surface differs in depth by more than a slanted surface does within a pixel.
  return std::abs(view.truth->depth_m(pixel) - point.z()) < 0.005;
}

bool covisible_in(const ScoredView& earlier, const ScoredView& current, const Landmark& landmark,
                  const Pinhole& camera) {
  int seen = 0;
  cv::Point pixel;
  for (const int k : landmark.keypoints) {
    const TruePoint point =
        true_point(current, current.landmarks->keypoints.keypoints[static_cast<size_t>(k)].pixel, camera);
    seen += shows(earlier, point.world, camera, pixel);
  }
  return 2 * seen >= static_cast<int>(landmark.keypoints.size());
}

// Of every fourth pixel and row inside `outline` in one view: the number visible in the other view, and the number of
// those inside `other`.
struct Overlap {
  int shown = 0, shared = 0;
};
Overlap overlap(const ScoredView& from, const std::vector<cv::Point>& outline, const ScoredView& to,
                const std::vector<cv::Point>& other, const Pinhole& camera) {
  constexpr int kEvery = 4;
  Overlap result;
  const cv::Rect box = cv::boundingRect(outline);
  for (int y = box.y; y < box.br().y; y += kEvery) {
    for (int x = box.x; x < box.br().x; x += kEvery) {
      if (cv::pointPolygonTest(outline, cv::Point2f(static_cast<float>(x), static_cast<float>(y)), false) < 0) continue;
      cv::Point there;
      if (!shows(to, true_point(from, {x, y}, camera).world, camera, there)) continue;
      ++result.shown;
      result.shared += cv::pointPolygonTest(other, cv::Point2f(there), false) >= 0;
    }
  }
  return result;
}

bool repeated_in(const ScoredView& earlier, const ScoredView& current, const Landmark& landmark,
                 const Pinhole& camera) {
  return std::any_of(earlier.landmarks->landmarks.begin(), earlier.landmarks->landmarks.end(),
                     [&](const Landmark& other) {
                       const Overlap forth = overlap(current, landmark.outline, earlier, other.outline, camera);
                       if (forth.shared == 0) return false;
                       const Overlap back = overlap(earlier, other.outline, current, landmark.outline, camera);
                       return 2 * forth.shared >= forth.shown + back.shown - back.shared;
                     });
}

double purity_of(const ScoredView& view, const Landmark& landmark, const Pinhole& camera) {
  std::map<int, int> counts;
  int most = 0;
  for (const int k : landmark.keypoints) {
    const Keypoint& keypoint = view.landmarks->keypoints.keypoints[static_cast<size_t>(k)];
    most = std::max(most, ++counts[true_point(view, keypoint.pixel, camera).object]);
  }
  return static_cast<double>(most) / static_cast<double>(std::max<size_t>(1, landmark.keypoints.size()));
}

}  // namespace

bool is_correct_match(const ScoredView& earlier, const ScoredView& current, const KeypointMatch& match,
                      const Pinhole& camera) {
  const Keypoint& e = earlier.landmarks->keypoints.keypoints[static_cast<size_t>(match.earlier)];
  const Keypoint& c = current.landmarks->keypoints.keypoints[static_cast<size_t>(match.current)];
  const TruePoint a = true_point(earlier, e.pixel, camera), b = true_point(current, c.pixel, camera);
  const double footprint = std::max(a.depth_m, b.depth_m) / std::min(camera.fx, camera.fy);
  return (a.world - b.world).norm() <= sigma_of(e) + sigma_of(c) + footprint / 2;  // false for NaN
}

LandmarkScore score_landmarks(const std::vector<ScoredView>& earlier, const ScoredView& current,
                              const std::vector<Recognition>& recognitions, const Pinhole& camera) {
  LandmarkScore score;
  const std::vector<Landmark>& landmarks = current.landmarks->landmarks;
  std::vector<int> right_of(landmarks.size(), 0);
  for (const Recognition& r : recognitions) {
    int right = 0;
    for (const KeypointMatch& match : r.matches)
      right += is_correct_match(earlier[static_cast<size_t>(r.earlier_frame)], current, match, camera);
    score.matches += static_cast<int>(r.matches.size());
    score.right += right;
    score.false_reidentifications += right < kRecognised;
    right_of[static_cast<size_t>(r.landmark)] = right;
  }
  score.landmarks = static_cast<int>(landmarks.size());
  for (size_t l = 0; l < landmarks.size(); ++l) {
    score.purity.push_back(purity_of(current, landmarks[l], camera));
    bool covisible = false, repeated = false;
    for (const ScoredView& view : earlier) {
      if (!covisible_in(view, current, landmarks[l], camera)) continue;
      covisible = true;
      repeated = repeated || repeated_in(view, current, landmarks[l], camera);
    }
    if (!covisible) continue;
    ++score.covisible;
    score.repeated += repeated;
    score.recognised += right_of[l] >= kRecognised;
  }
  return score;
}

}  // namespace fringeslam

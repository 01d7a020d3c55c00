// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/keypoints.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <tuple>

#include "core/landmarks/mutual_nearest.h"
#include "core/landmarks/sift.h"
#include "core/landmarks/sift_descriptor.h"

namespace fringeslam {

namespace {

struct SurfacePoint {
  Eigen::Vector3d point;
  double sigma = 0;  // of z
};

// Intersects the viewing ray of a sub-pixel position with the surface by bilinear interpolation of inverse depth,
// which is exact on planes; none across a discontinuity.
std::optional<SurfacePoint> surface_point(const Frame& frame, const PixelRays& rays, const Eigen::Vector2d& pixel) {
  const int col = static_cast<int>(std::floor(pixel.x())), row = static_cast<int>(std::floor(pixel.y()));
  if (col < 0 || row < 0 || col + 1 >= frame.width() || row + 1 >= frame.height()) return std::nullopt;
  const double wx = pixel.x() - col, wy = pixel.y() - row;
  double inverse = 0, variance = 0, low = std::numeric_limits<double>::infinity(), high = 0;
  Eigen::Vector2d ray = Eigen::Vector2d::Zero();
  for (int i = 0; i < 4; ++i) {
    const int r = row + i / 2, c = col + i % 2;
    if (!frame.valid(r, c)) return std::nullopt;
    const double weight = (i % 2 ? wx : 1 - wx) * (i / 2 ? wy : 1 - wy);
    const double z = frame.points_m(r, c)[2], sigma = frame.sigma_m(r, c);
    inverse += weight / z;
    variance += weight * weight * sigma * sigma;
    ray += weight * Eigen::Vector2d(rays(r, c)[0], rays(r, c)[1]);
    low = std::min(low, z);
    high = std::max(high, z);
  }
  // The four pixels must lie on one surface with a slope below about 80 degrees.
  const double footprint = (rays(row, col + 1)[0] - rays(row, col)[0]) * high;
  if (high - low > 8 * footprint + 6 * std::sqrt(variance)) return std::nullopt;
  return SurfacePoint{ray.homogeneous() / inverse, std::sqrt(variance)};
}

// P = z (x, y, 1): localisation noise acts along the image axes, depth noise along the ray.
Eigen::Matrix3d point_covariance(const SurfacePoint& surface, const Pinhole& camera, double pixel_sigma) {
  const double z = surface.point.z();
  const Eigen::Vector3d ray = surface.point / z;
  const double lateral = pixel_sigma * z;
  Eigen::Matrix3d covariance = surface.sigma * surface.sigma * ray * ray.transpose();
  covariance(0, 0) += lateral * lateral / (camera.fx * camera.fx);
  covariance(1, 1) += lateral * lateral / (camera.fy * camera.fy);
  // On a slanted surface a displaced keypoint also changes its depth; half of the lateral spread accounts for this,
  // since a keypoint's patch is only a few pixels wide.
  const double along = 0.5 * lateral / camera.fx;
  covariance(2, 2) += along * along;
  return covariance;
}

// Normalises to unit length. With RootSIFT (Arandjelovic and Zisserman 2012) the Euclidean distance of the square
// roots measures the overlap of the histograms.
cv::Mat1f normalised(cv::Mat1f descriptors, bool root_sift) {
  for (int i = 0; i < descriptors.rows; ++i) {
    cv::Mat1f row = descriptors.row(i);
    double sum = 0;
    for (const float value : row) sum += root_sift ? value : value * value;
    const double unit = std::max(sum, 1e-12);
    for (float& value : row) value = static_cast<float>(root_sift ? std::sqrt(value / unit) : value / std::sqrt(unit));
  }
  return descriptors;
}

// Detects features and converts coordinates of a halved image, whose pixel centres lie between those of the full
// image.
SiftFeatures features_of(const cv::Mat1b& image, bool half, const SiftOptions& options, Describe describe) {
  SiftFeatures features = sift(image, options, describe);
  for (SiftKeypoint& k : features.keypoints) {
    if (half) k.pixel = 2 * k.pixel + Eigen::Vector2d(0.5, 0.5), k.sigma *= 2;
  }
  return features;
}

cv::Mat1b halved(const cv::Mat1b& image) {
  cv::Mat1b half;
  cv::resize(image, half, {}, 0.5, 0.5, cv::INTER_AREA);
  return half;
}

}  // namespace

Keypoints detect_keypoints(const Frame& frame, const RigModel& rig, const PixelRays& rays,
                           const KeypointOptions& options) {
  check_options(options, "keypoints");
  const bool half = options.texture_halved && frame.height() > 1 && frame.width() > 1;
  const SiftFeatures found =
      features_of(half ? halved(frame.texture) : frame.texture, half,
                  {options.max_keypoints, options.contrast_threshold, options.edge_threshold}, Describe::yes);
  Keypoints result;
  result.detected = static_cast<int>(found.keypoints.size());
  result.descriptors = cv::Mat1f(0, kDescriptorSize);
  for (size_t i = 0; i < found.keypoints.size(); ++i) {
    const SiftKeypoint& k = found.keypoints[i];
    const auto surface = surface_point(frame, rays, k.pixel);
    if (!surface) continue;
    Keypoint keypoint;
    keypoint.pixel = k.pixel;
    keypoint.scale = k.sigma;
    keypoint.angle_rad = k.angle_rad;
    keypoint.strength = k.strength;
    keypoint.point_m = surface->point;
    keypoint.covariance_m2 =
        point_covariance(*surface, rig.camera, options.pixel_sigma * std::max(1.0, keypoint.scale / 1.6));
    result.keypoints.push_back(keypoint);
    result.descriptors.push_back(found.descriptors.row(static_cast<int>(i)));
  }
  result.descriptors = normalised(result.descriptors, options.root_sift);
  return result;
}

namespace {

// Stretches the levels between the 1st and the 99th percentile to 8 bits.
cv::Mat1b stretched(const cv::Mat1f& levels) {
  constexpr int kEvery = 11;  // every 11th pixel of a row suffices to estimate the range
  std::vector<float> sorted;
  for (int r = 0; r < levels.rows; ++r) {
    for (int c = r % kEvery; c < levels.cols; c += kEvery) sorted.push_back(levels(r, c));
  }
  if (sorted.empty()) sorted.assign(levels.begin(), levels.end());
  const auto quantile = [&](double q) {
    const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), at, sorted.end());
    return static_cast<double>(*at);
  };
  const double low = quantile(0.01), high = quantile(0.99);
  const double scale = 255 / std::max(high - low, 1.0);
  cv::Mat1b result;
  levels.convertTo(result, CV_8U, scale, -scale * low);
  return result;
}

}  // namespace

std::vector<DepthKeypoint> detect_depth_keypoints(const cv::Mat1f& levels, const KeypointOptions& options) {
  check_options(options, "keypoints");
  std::vector<DepthKeypoint> result;
  if (levels.empty()) return result;
  const bool half = options.depth_halved && levels.rows > 1 && levels.cols > 1;
  const SiftFeatures found = features_of(
      half ? halved(stretched(levels)) : stretched(levels), half,
      {options.max_depth_keypoints, options.depth_contrast_threshold, options.depth_edge_threshold}, Describe::no);
  for (const SiftKeypoint& k : found.keypoints) {
    DepthKeypoint keypoint;
    keypoint.pixel = k.pixel;
    keypoint.scale = k.sigma;
    keypoint.angle_rad = k.angle_rad;
    keypoint.strength = k.strength;
    const int row = static_cast<int>(std::lround(keypoint.pixel.y()));
    const int col = static_cast<int>(std::lround(keypoint.pixel.x()));
    const cv::Rect around = cv::Rect(col - 1, row - 1, 3, 3) & cv::Rect(0, 0, levels.cols, levels.rows);
    double nearest = 0;
    cv::minMaxLoc(levels(around), nullptr, &nearest);
    keypoint.level = static_cast<int>(std::clamp(nearest, 0.0, 255.0));
    // One orientation per position suffices, since depth keypoints are not matched.
    const bool again =
        !result.empty() && result.back().pixel == keypoint.pixel && result.back().scale == keypoint.scale;
    if (!again) result.push_back(keypoint);
  }
  return result;
}

std::vector<int> places_of(const std::vector<Keypoint>& keypoints) {
  std::vector<size_t> order(keypoints.size());
  std::iota(order.begin(), order.end(), 0);
  const auto key = [&](size_t i) { return std::tuple(keypoints[i].pixel.x(), keypoints[i].pixel.y(), i); };
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return key(a) < key(b); });
  std::vector<int> place(keypoints.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const bool again = i > 0 && keypoints[order[i]].pixel == keypoints[order[i - 1]].pixel;
    place[order[i]] = again ? place[order[i - 1]] : static_cast<int>(order[i]);
  }
  return place;
}

std::vector<KeypointMatch> match_keypoints(const Keypoints& earlier, const Keypoints& current,
                                           const MatchOptions& options) {
  check_options(options, "matching");
  // For unit vectors |a - b|^2 = 2 - 2 a.b.
  const auto distance2 = [&](int e, int c) {
    const Eigen::Map<const Eigen::VectorXf> a(earlier.descriptors[e], earlier.descriptors.cols);
    const Eigen::Map<const Eigen::VectorXf> b(current.descriptors[c], current.descriptors.cols);
    return std::max(0.0, 2.0 - 2.0 * static_cast<double>(a.dot(b)));
  };
  std::vector<KeypointMatch> matches;
  for (const MutualPair& pair :
       mutual_nearest(earlier.descriptors.rows, current.descriptors.rows, distance2, 1e-12, options.max_ratio))
    matches.push_back({pair.earlier, pair.current, pair.distance, pair.ratio});
  const std::vector<int> earlier_place = places_of(earlier.keypoints), current_place = places_of(current.keypoints);
  const auto in = [](const std::vector<int>& places) {
    return [&places](int keypoint) { return places[static_cast<size_t>(keypoint)]; };
  };
  keep_one_to_one(matches, earlier_place.size(), in(earlier_place), current_place.size(), in(current_place));
  std::sort(matches.begin(), matches.end(),
            [](const KeypointMatch& a, const KeypointMatch& b) { return a.current < b.current; });
  return matches;
}

}  // namespace fringeslam

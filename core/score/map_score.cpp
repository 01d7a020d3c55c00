// SPDX-License-Identifier: Apache-2.0
#include "core/score/map_score.h"

#include <algorithm>
#include <numbers>
#include <numeric>
#include <string>

#include "core/score/score.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kSteepest_deg = 80;
constexpr int kEvery = 4;

DistanceStatistics statistics(const std::vector<double>& distances_m) {
  DistanceStatistics s;
  s.points = distances_m.size();
  if (distances_m.empty()) return s;
  const auto n = static_cast<double>(distances_m.size());
  s.mean_m = std::accumulate(distances_m.begin(), distances_m.end(), 0.0) / n;
  s.rms_m = std::sqrt(std::inner_product(distances_m.begin(), distances_m.end(), distances_m.begin(), 0.0) / n);
  s.median_m = median_of(distances_m);
  s.p90_m = quantile_of(distances_m, 0.9);
  return s;
}

double share_within(const std::vector<double>& distances_m, double threshold_m) {
  const auto near = std::count_if(distances_m.begin(), distances_m.end(), [&](double d) { return d <= threshold_m; });
  return static_cast<double>(near) / static_cast<double>(std::max<size_t>(1, distances_m.size()));
}

void check_size(const char* name, const cv::Mat& image, const PixelRays& rays) {
  if (image.size() == rays.size()) return;
  throw Error(std::string("visible surface: the ground truth's ") + name + " has " + std::to_string(image.cols) + "x" +
              std::to_string(image.rows) + " px but the rig's camera " + std::to_string(rays.cols) + "x" +
              std::to_string(rays.rows));
}

}  // namespace

void append_visible_surface(const TruthFrame& truth, const RigModel& rig, const PixelRays& rays,
                            std::vector<Eigen::Vector3d>& seen) {
  check_size("mask", truth.mask, rays);
  check_size("depth", truth.depth_m, rays);
  check_size("normals", truth.normals, rays);
  check_size("position", truth.position_m, rays);
  const Eigen::Vector3d light = rig.projector_from_camera.inverse().translation;
  const double least_cosine = std::cos(kSteepest_deg * std::numbers::pi / 180);
  for (int row = kEvery / 2; row < truth.mask.rows; row += kEvery) {
    for (int col = kEvery / 2; col < truth.mask.cols; col += kEvery) {
      const double depth = truth.depth_m(row, col);
      if (!is_lit_surface(static_cast<int>(truth.mask(row, col)))) continue;
      if (depth < rig.near_m || depth > rig.far_m) continue;
      const cv::Vec3f &n = truth.normals(row, col), &p = truth.position_m(row, col);
      const Eigen::Vector3d normal(n[0], n[1], n[2]), ray(rays(row, col)[0], rays(row, col)[1], 1);
      const auto faces = [&](const Eigen::Vector3d& from) {
        return -normal.dot((depth * ray - from).normalized()) > least_cosine;
      };
      if (faces(Eigen::Vector3d::Zero()) && faces(light)) seen.emplace_back(p[0], p[1], p[2]);
    }
  }
}

MapScore score_map(const std::vector<double>& map_to_truth_m, const std::vector<double>& truth_to_map_m,
                   double threshold_m) {
  MapScore score;
  score.threshold_m = threshold_m;
  score.accuracy = statistics(map_to_truth_m);
  score.completeness = statistics(truth_to_map_m);
  score.precision = share_within(map_to_truth_m, threshold_m);
  score.recall = share_within(truth_to_map_m, threshold_m);
  return score;
}

}  // namespace fringeslam

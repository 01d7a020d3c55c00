// SPDX-License-Identifier: Apache-2.0
// The only file that includes PCL, whose templates take half a minute to compile.
#include "core/registration/reference/engines.h"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/parallel.h"

namespace fringeslam {

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

constexpr int kLeastPoints = 100;

Cloud::Ptr cloud_of(const Frame& frame, int every) {
  Cloud::Ptr cloud(new Cloud);
  for (int row = 0; row < frame.height(); row += every) {
    for (int col = 0; col < frame.width(); col += every) {
      if (!frame.valid(row, col)) continue;
      const cv::Vec3f& p = frame.points_m(row, col);
      cloud->push_back({p[0], p[1], p[2]});
    }
  }
  return cloud;
}

Eigen::Vector3d at(const Cloud& cloud, int i) { return cloud[static_cast<size_t>(i)].getVector3fMap().cast<double>(); }

// The nearest target point of each source point under a motion.
class NearestPoints {
 public:
  NearestPoints(const Cloud::Ptr& target, const Cloud& source) : target_(*target), source_(source) {
    tree_.setInputCloud(target);
  }

  struct Pair {
    int source, target;
    double distance_m;
  };
  // Pairs every `step`-th source point.
  std::vector<Pair> pairs(const Pose& pose, int step) const {
    std::vector<Pair> pairs((source_.size() + static_cast<size_t>(step) - 1) / static_cast<size_t>(step));
    constexpr int kBlock = 256;
    for_each_row(static_cast<int>(pairs.size()) / kBlock + 1, [&](int block) {
      std::vector<int> index(1);
      std::vector<float> square(1);
      const size_t end = std::min(pairs.size(), static_cast<size_t>(block + 1) * kBlock);
      for (size_t k = static_cast<size_t>(block) * kBlock; k < end; ++k) {
        const int i = static_cast<int>(k) * step;
        const Eigen::Vector3d moved = pose * at(source_, i);
        tree_.nearestKSearch(
            pcl::PointXYZ(static_cast<float>(moved.x()), static_cast<float>(moved.y()), static_cast<float>(moved.z())),
            1, index, square);
        pairs[k] = {i, index[0], std::sqrt(static_cast<double>(square[0]))};
      }
    });
    return pairs;
  }

  Pose fitted(const std::vector<Pair>& pairs) const {
    std::vector<Eigen::Vector3d> to, from;
    for (const Pair& pair : pairs) {
      to.push_back(at(target_, pair.target));
      from.push_back(at(source_, pair.source));
    }
    return align_points(to, from);
  }

 private:
  const Cloud &target_, &source_;
  pcl::KdTreeFLANN<pcl::PointXYZ> tree_;
};

double mean_square(const std::vector<NearestPoints::Pair>& pairs) {
  double sum = 0;
  for (const auto& pair : pairs) sum += pair.distance_m * pair.distance_m;
  return sum / static_cast<double>(pairs.size());
}

// Sets counts and information from the pairs within a distance.
void describe_fit(IcpResult& result, const NearestPoints& nearest, const Cloud& source, double distance_m) {
  auto pairs = nearest.pairs(result.target_from_source, 1);
  const auto all = static_cast<double>(pairs.size());
  std::erase_if(pairs, [&](const auto& pair) { return pair.distance_m > distance_m; });
  result.pairs = static_cast<int>(pairs.size());
  result.overlap = static_cast<double>(pairs.size()) / all;
  if (pairs.empty()) return;
  const double square = std::max(mean_square(pairs), 1e-18);
  result.rms_m = std::sqrt(square);
  for (const auto& pair : pairs) {
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian << -skew(result.target_from_source.rotation * at(source, pair.source)), Eigen::Matrix3d::Identity();
    result.information += jacobian.transpose() * jacobian / square;
  }
}

IcpResult besl_mckay(const NearestPoints& nearest, const Pose& initial, const IcpOptions& options) {
  constexpr double kSettled = 1e-4;  // relative change of the mean square
  IcpResult result;
  result.target_from_source = initial;
  double last = std::numeric_limits<double>::infinity();
  while (result.iterations < options.max_iterations && !result.converged) {
    const auto pairs = nearest.pairs(result.target_from_source, 1);
    result.target_from_source = nearest.fitted(pairs);
    ++result.iterations;
    const double square = mean_square(pairs);
    result.converged = std::abs(last - square) <= kSettled * square;
    last = square;
  }
  return result;
}

// Zhang 1994, section 3.2: largest distance of a pair in the next round.
double next_max_distance(const std::vector<NearestPoints::Pair>& pairs, double good_m) {
  double mean = 0, square = 0;
  for (const auto& pair : pairs) mean += pair.distance_m, square += pair.distance_m * pair.distance_m;
  mean /= static_cast<double>(pairs.size());
  const double spread = std::sqrt(std::max(0.0, square / static_cast<double>(pairs.size()) - mean * mean));
  if (mean < good_m) return mean + 3 * spread;
  if (mean < 3 * good_m) return mean + 2 * spread;
  if (mean < 6 * good_m) return mean + spread;
  std::vector<double> distances;
  for (const auto& pair : pairs) distances.push_back(pair.distance_m);
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2),
                   distances.end());
  return distances[distances.size() / 2];
}

IcpResult zhang(const NearestPoints& nearest, const Pose& initial, const IcpOptions& options, double spacing_m) {
  constexpr int kSparse = 5;
  constexpr double kSettled_m = 1e-6, kSettled_rad = 1e-6;
  IcpResult result;
  result.target_from_source = initial;
  double reach = options.max_distance_m;
  for (int step = kSparse; result.iterations < options.max_iterations && !result.converged; ++result.iterations) {
    auto pairs = nearest.pairs(result.target_from_source, step);
    std::erase_if(pairs, [&](const auto& pair) { return pair.distance_m > reach; });
    if (static_cast<int>(pairs.size()) < kLeastPoints / kSparse) return result;
    reach = next_max_distance(pairs, 3 * spacing_m);
    std::erase_if(pairs, [&](const auto& pair) { return pair.distance_m > reach; });
    const Pose pose = nearest.fitted(pairs);
    const Pose change = pose * result.target_from_source.inverse();
    result.target_from_source = pose;
    if (translation_m(change) > kSettled_m || rotation_rad(change) > kSettled_rad) continue;
    result.converged = step == 1;
    step = 1;
  }
  return result;
}

// PCL works in single precision, so the clouds are centred at the origin first.
template <class Engine>
IcpResult by_pcl(const Cloud& target, const Cloud& source, const Pose& initial, const IcpOptions& options) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (int i = 0; i < static_cast<int>(target.size()); ++i)
    middle += at(target, i) / static_cast<double>(target.size());
  const auto centred = [&](const Cloud& cloud) {
    Cloud::Ptr moved(new Cloud);
    for (int i = 0; i < static_cast<int>(cloud.size()); ++i) {
      const Eigen::Vector3d p = at(cloud, i) - middle;
      moved->push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())});
    }
    return moved;
  };
  const Pose to_middle{Eigen::Matrix3d::Identity(), middle};
  const Pose start = to_middle.inverse() * initial * to_middle;
  Engine engine;
  engine.setInputSource(centred(source));
  engine.setInputTarget(centred(target));
  engine.setMaxCorrespondenceDistance(options.max_distance_m);
  engine.setMaximumIterations(options.max_iterations);
  engine.setTransformationEpsilon(1e-7);
  Eigen::Matrix4f guess = Eigen::Matrix4f::Identity();
  guess.topLeftCorner<3, 3>() = start.rotation.cast<float>();
  guess.topRightCorner<3, 1>() = start.translation.cast<float>();
  Cloud aligned;
  engine.align(aligned, guess);
  const Eigen::Matrix4d found = engine.getFinalTransformation().template cast<double>();
  IcpResult result;
  result.target_from_source =
      to_middle * orthonormalised({found.topLeftCorner<3, 3>(), Eigen::Vector3d(found.topRightCorner<3, 1>())}) *
      to_middle.inverse();
  result.converged = engine.hasConverged();
  return result;
}

// Typical distance between neighbouring points.
double spacing(const Frame& frame, const Pinhole& camera, int every) {
  std::vector<float> depths;
  for (const cv::Vec3f& p : frame.points_m) {
    if (!std::isnan(p[2])) depths.push_back(p[2]);
  }
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return every * static_cast<double>(*middle) / camera.fx;
}

}  // namespace

IcpResult register_with_engine(RegistrationEngine engine, const Frame& target, const Frame& source,
                               const Pinhole& camera, const Pose& initial, const IcpOptions& options,
                               int points_every) {
  check_options(options, "icp");
  if (engine == RegistrationEngine::point_to_plane) return point_to_plane_icp(target, source, camera, initial, options);
  const Cloud::Ptr to = cloud_of(target, points_every), from = cloud_of(source, points_every);
  IcpResult none;
  none.target_from_source = initial;
  if (std::min(to->size(), from->size()) < kLeastPoints) return none;
  const NearestPoints nearest(to, *from);
  const double apart = spacing(target, camera, points_every);
  IcpResult result;
  if (engine == RegistrationEngine::besl_mckay) result = besl_mckay(nearest, initial, options);
  if (engine == RegistrationEngine::zhang) result = zhang(nearest, initial, options, apart);
  if (engine == RegistrationEngine::pcl_icp)
    result = by_pcl<pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>>(*to, *from, initial, options);
  if (engine == RegistrationEngine::pcl_gicp)
    result = by_pcl<pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>>(*to, *from, initial, options);
  if (!result.target_from_source.is_finite()) return none;
  describe_fit(result, nearest, *from, 3 * apart);
  result.converged = result.converged && result.pairs >= kLeastPoints && result.overlap >= options.min_overlap;
  return result;
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// PCL on a folder of `render --format tum-rgbd`: frame-to-frame odometry by ICP, generalized ICP or NDT.
//
//   fringeslam-pcl-odometry FOLDER OUT icp|gicp|ndt
//
// Clouds are reduced to one point per 10 mm voxel; each registration starts from rest. Writes OUT/trajectory.tum.
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_types.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/ndt.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/io/files.h"
#include "core/types/trajectory.h"

namespace fringeslam {
namespace {

namespace fs = std::filesystem;
using Cloud = pcl::PointCloud<pcl::PointXYZ>;

constexpr double kUnitsPerM = 5000;
constexpr float kVoxel_m = 0.01f;
constexpr double kDistance_m = 0.05;
constexpr double kLeastOverlap = 0.1;  // share of points with a neighbor within kDistance_m, as for Open3D

struct Lens {
  double fx, fy, cx, cy;
};

Lens read_lens(const fs::path& file) {
  const auto k = nlohmann::json::parse(std::ifstream(file)).at("intrinsic_matrix").get<std::vector<double>>();
  return {k.at(0), k.at(4), k.at(6), k.at(7)};
}

Cloud::Ptr read_cloud(const fs::path& file, const Lens& lens) {
  const cv::Mat1w depth = read_grey(file);
  const Cloud::Ptr all(new Cloud), reduced(new Cloud);
  for (int row = 0; row < depth.rows; ++row) {
    for (int col = 0; col < depth.cols; ++col) {
      const double z = depth(row, col) / kUnitsPerM;
      if (z > 0)
        all->push_back({static_cast<float>((col - lens.cx) / lens.fx * z),
                        static_cast<float>((row - lens.cy) / lens.fy * z), static_cast<float>(z)});
    }
  }
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  grid.setInputCloud(all);
  grid.setLeafSize(kVoxel_m, kVoxel_m, kVoxel_m);
  grid.filter(*reduced);
  return reduced;
}

using Registration = pcl::Registration<pcl::PointXYZ, pcl::PointXYZ>;

// Returns the share of points that have a neighbor in the registration's target.
double overlap(Registration& registration, const Cloud& aligned) {
  pcl::Indices found;
  std::vector<float> squared;
  const auto near = std::count_if(aligned.begin(), aligned.end(), [&](const pcl::PointXYZ& point) {
    return registration.getSearchMethodTarget()->radiusSearch(point, kDistance_m, found, squared, 1) > 0;
  });
  return static_cast<double>(near) / static_cast<double>(std::max<size_t>(1, aligned.size()));
}

std::unique_ptr<Registration> method_of(const std::string& name) {
  if (name == "ndt") {
    auto ndt = std::make_unique<pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ>>();
    ndt->setResolution(0.05f);
    ndt->setStepSize(0.02);
    ndt->setTransformationEpsilon(1e-5);
    return ndt;
  }
  if (name == "gicp") return std::make_unique<pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>>();
  if (name == "icp") return std::make_unique<pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>>();
  throw Error(name + ": is not one of icp gicp ndt");
}

void run(const fs::path& folder, const fs::path& out, const std::string& method) {
  const Lens lens = read_lens(folder / "intrinsic.json");
  const auto registration = method_of(method);
  registration->setMaxCorrespondenceDistance(kDistance_m);
  registration->setMaximumIterations(50);
  std::ifstream associations(folder / "associations.txt");
  Trajectory trajectory;
  Cloud::Ptr last;
  Pose pose;
  for (std::string line; std::getline(associations, line);) {
    if (line.empty() || line.front() == '#') continue;
    std::istringstream fields(line);
    double time_s = 0, depth_time_s = 0;
    std::string texture, depth;
    fields >> time_s >> texture >> depth_time_s >> depth;
    const Cloud::Ptr cloud = read_cloud(folder / depth, lens);
    if (last) {
      registration->setInputTarget(last);
      registration->setInputSource(cloud);
      Cloud aligned;
      registration->align(aligned);
      if (!registration->hasConverged() || overlap(*registration, aligned) < kLeastOverlap) continue;
      const Eigen::Matrix4d motion = registration->getFinalTransformation().cast<double>();
      pose = orthonormalised(pose * Pose{motion.topLeftCorner<3, 3>(), motion.topRightCorner<3, 1>()});
    }
    last = cloud;
    trajectory.push_back({time_s, pose});
  }
  write_text(out / "trajectory.tum", to_tum(trajectory));
}

}  // namespace
}  // namespace fringeslam

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: fringeslam-pcl-odometry FOLDER OUT icp|gicp|ndt\n");
    return 2;
  }
  try {
    fringeslam::run(argv[1], argv[2], argv[3]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
  return 0;
}

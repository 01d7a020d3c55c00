// SPDX-License-Identifier: Apache-2.0
// Writes what an RGB-D camera in place of the sensor would deliver, in the folder layout of the TUM RGB-D benchmark
// (J. Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012), which other systems read:
//
//   rgb/TIME.png           fringe-free texture, 8 bits, three equal channels
//   depth/TIME.png         z at the same pixels, in units of 1 / units_per_m, 16 bits, 0 = no data
//   rgb.txt  depth.txt     timestamp file
//   associations.txt       timestamp rgb timestamp depth
//   groundtruth.txt        timestamp tx ty tz qx qy qz qw, world_from_camera; only with ground truth
//   camera.yaml            settings file for ORB-SLAM3: lens, size, depth factor, keypoints
//   intrinsic.json         the lens for Open3D
//   rig.yaml  render.yaml  resolved_scene.yaml   as in datasets
#pragma once

#include "tools/settings.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

constexpr const char* kTumTruthFile = "groundtruth.txt";

struct TumRgbdOptions {
  std::string depth = "measured";  // decoded from the fringes and triangulated; or "truth"
  double units_per_m = 5000;
  bool distorted = false;  // keep the lens distortion; otherwise scenes are rendered without it
};

// Converts depth to 16-bit units; 0 where there is no depth or it exceeds 65535 units.
cv::Mat1w depth_units(const cv::Mat1f& depth_m, double units_per_m);

// Writes the complete folder or nothing and returns the number of images. Throws Error if the source cannot provide
// what `options` ask for.
int write_tum_rgbd(Source& source, const Settings& settings, const TumRgbdOptions& options,
                   const std::filesystem::path& out, const Common& common);

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// What an RGB-D camera in place of the sensor would hand over, in the folder layout of the TUM RGB-D benchmark
// (J. Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012), which other systems read:
//
//   rgb/TIME.png           fringe-free texture, 8 bits, the same in three channels
//   depth/TIME.png         z in units of 1 / units_per_m, 16 bits, 0 = no data; of the same pixels
//   rgb.txt  depth.txt     timestamp file
//   associations.txt       timestamp rgb timestamp depth
//   groundtruth.txt        timestamp tx ty tz qx qy qz qw, world_from_camera; only where the truth is known
//   camera.yaml            settings file of ORB-SLAM3: lens, size, depth factor, keypoints
//   intrinsic.json         the lens as Open3D reads it
//   rig.yaml  render.yaml  resolved_scene.yaml   as in datasets
#pragma once

#include "tools/settings.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

constexpr const char* kTumTruthFile = "groundtruth.txt";

struct TumRgbdOptions {
  std::string depth = "measured";  // as decoded from the fringes and triangulated, or "truth"
  double units_per_m = 5000;
  bool distorted = false;  // keep the lens's distortion; else scenes are rendered without it
};

// 0 where there is no depth or the format's 65535 units do not reach.
cv::Mat1w depth_units(const cv::Mat1f& depth_m, double units_per_m);

// Writes the folder whole or not at all; returns the number of images. Throws Error when what is asked for is not to
// be had from the source.
int write_tum_rgbd(Source& source, const Settings& settings, const TumRgbdOptions& options,
                   const std::filesystem::path& out, const Common& common);

}  // namespace fringeslam::tools

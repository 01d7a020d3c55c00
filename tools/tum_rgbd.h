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

#include "tools/rgbd.h"

namespace fringeslam::tools {

constexpr const char* kTumTruthFile = "groundtruth.txt";

// Writes the true trajectory of the camera with a heading.
void write_camera_truth(const std::filesystem::path& file, const Trajectory& camera);

// Writes the complete folder or nothing and returns the number of images. Throws Error if the source cannot provide
// what `options` ask for.
int write_tum_rgbd(Source& source, const Settings& settings, const RgbdOptions& options,
                   const std::filesystem::path& out, const Common& common);

}  // namespace fringeslam::tools

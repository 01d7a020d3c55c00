// SPDX-License-Identifier: Apache-2.0
// Writes what an RGB-D camera in place of the sensor would deliver, in a folder layout like that of the EuRoC MAV
// datasets (M. Burri et al., The EuRoC micro aerial vehicle datasets, IJRR 2016):
//
//   mav0/cam0/data.csv, data/TIME.png      fringe-free texture, 8 bits
//   mav0/cam0/sensor.yaml                  lens, size, rate
//   mav0/depth0/data.csv, data/TIME.png    z at the same pixels, in units of 1 / units_per_m, 16 bits, 0 = no data
//   mav0/depth0/sensor.yaml                the same, and units_per_m
//   mav0/body.yaml
//   mav0/state_groundtruth_estimate0/      data.csv, sensor.yaml: world_from_camera; only with ground truth
//   rig.yaml  render.yaml  resolved_scene.yaml   as in datasets
//
// TIME is in nanoseconds with 19 digits: capture time plus clock_offset_s (tools/bag/bag_dataset.h). Unlike EuRoC, there
// is no inertial sensor and no second camera, but a depth image, and the body is the camera (T_BS of cam0 is the
// identity), so poses of body and camera are the same. Ground truth has no velocities and biases.
#pragma once

#include "tools/rgbd.h"

namespace fringeslam::tools {

constexpr const char* kEurocTruthFile = "mav0/state_groundtruth_estimate0/data.csv";

// Writes the complete folder or nothing; `with_truth` adds the true trajectory. Throws Error if the source cannot
// provide what `options` ask for.
WrittenViews write_euroc(Source& source, const Settings& settings, const RgbdOptions& options, bool with_truth,
                         const std::filesystem::path& out, const Common& common);

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// The files of a sample. Images have the camera's size unless stated otherwise; in EXR files, NaN marks pixels without
// data.
//
//   json                   poses, times, drawn values
//   rig.yaml               calibration, as given to an algorithm
//   patterns.yaml          pattern of each fringe image
//   image.000.png …        fringe images, gray, 8 or 16 bits (.exr if unquantized)
//   thermal.png            size of the thermal camera, hundredths of a kelvin, 16 bits (.exr in degrees C if unquantized)
//   depth.exr              depth_m
//   normals.exr            normal.x .y .z: unit, camera frame, facing the camera
//   coordinate.exr         projector_column, projector_row, px
//   phase.exr              phase.columns.16.5 …: absolute phase 2 pi (u + 1/2) / period of the finest period of each axis
//   order.columns.16.5.png …   number of whole periods before the point, for each period; 16 bits, 65535: none
//   sigma.exr              column_sigma_px, row_sigma_px, depth_sigma_m: standard deviation due to the camera's noise
//   objects.png            number of the object from 1, in scene order, 16 bits; 0: no surface (.exr beyond 65534)
//   mask.png               sum of TruthMask bits (core/types/truth.h), 8 bits
//   temperature.exr        temperature_c of the surface
#pragma once

#include <string>
#include <vector>

#include "bench/datasets/spec.h"
#include "core/decode/decode.h"

namespace fringeslam::datasets {

struct SampleFile {
  std::string extension;  // "depth.exr"
  std::string bytes;
};

// Standard deviations of a view due to the noise of the camera: of the projector coordinate, propagated from the gray
// values through the estimator of the finest period's phase, and of the depth. All are H x W; NaN outside the projector's
// field and where the images are saturated.
struct PredictedSigma {
  cv::Mat1f column_px, row_px;  // empty: the axis is not coded by three or more shifts of a fringe
  cv::Mat1f depth_m;            // of the columns, else of the rows; empty: neither is coded
};
PredictedSigma predicted_sigma(const sim::SimulatedView& view, const RigModel& rig, const PixelRays& rays,
                               const DecodeOptions& options);

// Values that the files of all views of a trial share.
struct TrialContext {
  const Spec& spec;
  const studies::Trial& trial;
  const sim::Scene& scene;
  const RigModel& calibration;
  const PixelRays& rays;  // of the scene's camera
  const DecodeOptions& decode;
};

// Returns the name of a sample, such as "000000042".
std::string sample_name(int sample);

// Returns the files of one view, sorted by extension.
std::vector<SampleFile> sample_files(const TrialContext& context, const sim::SimulatedView& view, int view_number);

}  // namespace fringeslam::datasets

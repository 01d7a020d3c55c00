// SPDX-License-Identifier: Apache-2.0
// Calibrations of a camera and a projector in OpenCV's files (cv::FileStorage: YAML, XML, JSON).
//
// Matrices are [fx 0 cx; 0 fy cy; 0 0 1] with integer coordinates at pixel centres; distortion is k1 k2 p1 p2 (k3) as
// in core/types/pinhole.h. Rotation (3 x 3, or a Rodrigues vector of 3) and translation are those of stereoCalibrate
// with the camera first, x_projector = R x_camera + T, or of the other direction when that is said.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Names of the entries: NAME, or FILE:NAME where several files have that name. Empty: the usual names are tried.
struct CalibrationNames {
  std::string camera_matrix, camera_distortion;  // distortion "none": a lens without any
  std::string projector_matrix, projector_distortion;
  std::string rotation, translation;
  std::string camera_size, projector_size;  // width and height, px
};

struct CalibrationFiles {
  std::vector<std::filesystem::path> files;
  CalibrationNames names;
  bool projector_from_camera = true;  // or the rotation and translation are camera_from_projector
  double unit_m = 0.001;              // of the translation
};

struct RigCalibration {
  Pinhole camera, projector;  // width and height are 0 where the files do not tell
  Pose projector_from_camera;
};

// Throws Error, naming the file and the entry, for what is missing, ambiguous or no calibration: skew, more distortion
// terms than five that are not zero, a matrix that is no rotation. One that is a rotation but for rounding is made one.
RigCalibration read_opencv_calibration(const CalibrationFiles& source);

}  // namespace fringeslam

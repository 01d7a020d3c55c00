// SPDX-License-Identifier: Apache-2.0
// Reads camera-projector calibrations from OpenCV files (cv::FileStorage: YAML, XML, JSON).
//
// Camera matrices are [fx 0 cx; 0 fy cy; 0 0 1] with integer coordinates at pixel centres; distortion is k1 k2 p1 p2
// (k3) as in core/types/pinhole.h. Rotation (3 x 3 matrix or Rodrigues vector) and translation follow stereoCalibrate
// with the camera first, x_projector = R x_camera + T, or the opposite direction if specified.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Entry names: NAME, or FILE:NAME if several files contain the name. Empty: common names are tried.
struct CalibrationNames {
  std::string camera_matrix, camera_distortion;  // distortion "none": no lens distortion
  std::string projector_matrix, projector_distortion;
  std::string rotation, translation;
  std::string camera_size, projector_size;  // width and height, px
};

struct CalibrationFiles {
  std::vector<std::filesystem::path> files;
  CalibrationNames names;
  bool projector_from_camera = true;  // false: rotation and translation are camera_from_projector
  double unit_m = 0.001;              // of the translation
};

struct RigCalibration {
  Pinhole camera, projector;  // width and height are 0 if not in the files
  Pose projector_from_camera;
};

// Reads a calibration in a restricted child process, because OpenCV's parser can be made to crash or allocate without bound.
// Throws Error naming the file and the entry if it is missing, ambiguous or unsupported: non-zero skew, more than five
// non-zero distortion coefficients, or a matrix that is not a rotation; also if a file is larger than 16 MiB. Rotations are
// orthonormalised to remove rounding.
RigCalibration read_opencv_calibration(const CalibrationFiles& source);

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Surface points followed through the exposures of a stack (docs/method.md, section 9.1): where each exposure sees them,
// how they are lit there, and the mean and phase of one period that fit these samples, with derivatives with respect to
// the motion. The values of a group of points lie in arrays, so that SIMD code processes several points at once.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pose.h"
#include "core/types/rig_model.h"

namespace fringeslam {

constexpr int kPointsTogether = 64;
using PointArray = std::array<double, kPointsTogether>;

// Points at the reference time, in the camera's axes.
struct SurfacePoints {
  int count = 0;
  PointArray x, y, z;                       // m
  PointArray normal_x, normal_y, normal_z;  // unit length
  PointArray lit_px;                        // projector coordinate
  PointArray lit_by_x, lit_by_y, lit_by_z;  // its derivatives with respect to the point, px/m
  PointArray brightness;                    // of the point's pixel, up to a factor
};

// Samples of one exposure at the points.
struct PointSamples {
  PointArray x, y, z;                 // the points in the exposure's axes, m
  PointArray u, v;                    // their pixels; NaN behind the camera
  PointArray u_by_x, u_by_y, u_by_z;  // px/m
  PointArray v_by_x, v_by_y, v_by_z;
  PointArray grey;  // as if exposed from the reference pose, DN; NaN outside the image and beside saturated pixels
  PointArray grey_by_u, grey_by_v;             // DN/px
  PointArray texture_x, texture_y, texture_z;  // derivatives of the grey value with respect to the point, DN/m
  PointArray lit_px, lit_by_x, lit_by_y, lit_by_z;
  PointArray cosine, sine;  // of the fringe's phase relative to that of the point's coordinate
};

constexpr int kMotionOrders = 3;  // velocity, acceleration and jerk, six values each
constexpr int kMotionParameters = 6 * kMotionOrders;

// Fits of one period. NaN where a sample is.
struct PeriodFits {
  PointArray mean, mean_variance;                                     // DN, DN^2
  PointArray phase, phase_variance;                                   // rad, rad^2
  PointArray modulation;                                              // DN
  std::array<PointArray, kMotionParameters> mean_slope, phase_slope;  // derivatives with respect to the motion
};

class PointFollower {
 public:
  // `axis`: 0 for projector columns, 1 for rows.
  PointFollower(const RigModel& rig, int axis);

  // Fills in how the points are lit at the reference time and, with their normals, how bright they are.
  void light(SurfacePoints& points, bool with_brightness) const;

  // An exposure: its image, its time from the reference time, and its fringes.
  struct Exposure {
    const cv::Mat1f* image = nullptr;
    double time_s = 0, shift_rad = 0;
    Pose exposure_from_reference;
  };

  // Samples an exposure at points with their brightness, or without.
  void sample(const Exposure& exposure, double period_px, const SurfacePoints& points, bool with_brightness,
              PointSamples& out) const;

  // The same for a camera at rest, which sees the points at their own pixels: in columns `cols` of a row inside the image.
  void sample_at_rest(const Exposure& exposure, const SurfacePoints& points, int row, const int* cols,
                      PointSamples& out) const;

  // Fits grey = mean + c cos - s sin to the samples of a period's exposures. Each grey value is the average of
  // `averaged` pixels.
  void fit(int count, const std::vector<PointSamples>& samples, const std::vector<const Exposure*>& exposures,
           double period_px, double averaged, PeriodFits& out) const;

  // The rig in the form that the kernels use.
  struct Lens {
    double fx, fy, cx, cy, k1, k2, p1, p2, k3;
  };
  struct Values {
    Lens camera, projector;
    double r[9], t[3];  // projector_from_camera; the rotation by rows
    int axis;
    double offset_dn, dark_dn2, gain_dn;  // variance of a grey value: dark_dn2 + gain_dn (grey - offset_dn)
  };

 private:
  Values rig_;
  double projector_fall_off_, camera_fall_off_;
};

}  // namespace fringeslam

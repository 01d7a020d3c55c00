// SPDX-License-Identifier: Apache-2.0
// Detects vibration of the camera from changes of its motion that were not predicted (docs/method.md, section 9.4).
#pragma once

#include <cstddef>
#include <deque>

#include "core/mapper/motion_predictor.h"
#include "core/types/camera_motion.h"

namespace fringeslam {

class Vibration {
 public:
  explicit Vibration(double camera_rate_hz) : camera_rate_hz_(camera_rate_hz) {}

  void set_camera_rate(double hz) { camera_rate_hz_ = hz; }
  double camera_rate_hz() const { return camera_rate_hz_; }
  // `interval_s`: since the last tracked view.
  void begin_view(double interval_s) {
    here_ = {};
    interval_s_ = interval_s;
  }
  // Notes how the motion during the current view differs from its prediction, given the covariances of both. Returns true
  // if the difference is clearly larger than those of the last views.
  bool note(const Vector12d& change, const Matrix12d& of_prediction, const Matrix12d& of_motion);
  // Notes the vibration that the poses of the last views reveal.
  void note(const VibrationEstimate& revealed) { revealed_ = revealed; }
  void end_view();  // the view is tracked
  void restart();   // tracking was lost before the current view

  // Widens the covariance of a motion, as a prior, by the largest unpredicted changes of the last views.
  void widen(Matrix12d& covariance) const;
  // The same by vibration that the poses of the last views do not exclude: `covariance` is of an estimated motion.
  void widen_estimate(Matrix12d& covariance) const;

 private:
  // Mean squares of the components of unpredicted changes of the motion.
  struct Changes {
    double angular_rad2_s2 = 0, velocity_m2_s2 = 0;
  };
  Changes recent() const;
  Changes changes_of(const Jitter& jitter) const;
  void widen(Matrix12d& covariance, const Changes& changes) const;

  double camera_rate_hz_;
  double interval_s_ = 0;
  Changes here_;
  std::deque<Changes> last_;  // of the last views
  size_t views_ = 0;          // since tracking was last lost
  VibrationEstimate revealed_;
};

}  // namespace fringeslam

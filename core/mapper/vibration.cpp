// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/vibration.h"

#include <algorithm>

#include "core/types/linear_algebra.h"

namespace fringeslam {

bool Vibration::note(const Vector12d& change, const Matrix12d& of_prediction, const Matrix12d& of_motion) {
  constexpr double kSmooth = 1e-2;  // m/s or rad/s
  constexpr double kSigmas = 3, kClearly = 2;
  constexpr size_t kFew = 4;
  const auto excess = [&](int first) {
    // The first views are predicted from motions that their stacks determined by themselves. Later, the predictor adapts
    // to vibration and inflates its covariance.
    const double doubtful = views_ < kFew ? kSigmas * kSigmas * of_prediction.diagonal().segment<3>(first).mean() : 0;
    const Eigen::Vector3d difference = change.segment<3>(first);
    const double square = difference.squaredNorm() / 3;
    if (square <= std::max(doubtful, kSmooth * kSmooth)) return 0.0;
    // Once vibration widens the prior, depths leave some directions to chance: their errors must not prolong it.
    const Eigen::MatrixXd uncertain = of_motion.block<3, 3>(first, first);
    const double sigmas2 = difference.dot(solve_positive_definite(uncertain, Eigen::VectorXd(difference)));
    return sigmas2 > 3 * kSigmas * kSigmas ? square : 0.0;
  };
  const Changes before = recent();
  here_ = {std::max(here_.angular_rad2_s2, excess(0)), std::max(here_.velocity_m2_s2, excess(3))};
  return here_.angular_rad2_s2 > kClearly * before.angular_rad2_s2 ||
         here_.velocity_m2_s2 > kClearly * before.velocity_m2_s2;
}

void Vibration::end_view() {
  constexpr size_t kViews = 8;
  last_.push_back(here_);
  if (last_.size() > kViews) last_.pop_front();
  ++views_;
}

void Vibration::restart() {
  last_.clear();
  views_ = 0;
  revealed_ = {};
}

// A camera whose velocity changes suddenly from view to view vibrates, and its velocity changes as much from image to
// image: poses at the rate of the views do not show such accelerations.
void Vibration::widen(Matrix12d& covariance) const { widen(covariance, recent()); }

void Vibration::widen_estimate(Matrix12d& covariance) const { widen(covariance, changes_of(revealed_.expected)); }

void Vibration::widen(Matrix12d& covariance, const Changes& changes) const {
  const double per_s = 2 * camera_rate_hz_, per_s2 = per_s * per_s;
  covariance.diagonal().segment<3>(0).array() += changes.angular_rad2_s2;
  covariance.diagonal().segment<3>(3).array() += changes.velocity_m2_s2;
  covariance.diagonal().segment<3>(6).array() += per_s2 * changes.angular_rad2_s2;
  covariance.diagonal().segment<3>(9).array() += per_s2 * changes.velocity_m2_s2;
}

Vibration::Changes Vibration::changes_of(const Jitter& jitter) const {
  const double rate = velocity_of_jitter(camera_rate_hz_), turn = rate * jitter.turn_rad, shift = rate * jitter.shift_m;
  return {turn * turn, shift * shift};
}

// The largest changes of the current and the last views.
Vibration::Changes Vibration::recent() const {
  constexpr double kSparse_s = 0.05;
  // Poses that are far apart hardly predict the velocity, so a prior that covers every likely vibration costs nothing.
  // Those of consecutive views do, and only vibration that is certain outweighs them.
  const Changes shown = changes_of(interval_s_ > kSparse_s ? revealed_.expected : revealed_.least);
  Changes most{std::max(here_.angular_rad2_s2, shown.angular_rad2_s2),
               std::max(here_.velocity_m2_s2, shown.velocity_m2_s2)};
  for (const Changes& view : last_) {
    most.angular_rad2_s2 = std::max(most.angular_rad2_s2, view.angular_rad2_s2);
    most.velocity_m2_s2 = std::max(most.velocity_m2_s2, view.velocity_m2_s2);
  }
  return most;
}

}  // namespace fringeslam

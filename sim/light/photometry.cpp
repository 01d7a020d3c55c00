// SPDX-License-Identifier: Apache-2.0
#include "sim/light/photometry.h"

#include <array>
#include <cmath>

#include "core/types/camera_pupil.h"

namespace fringeslam::sim {

double photons_per_lux_s(const RigModel& rig) {
  constexpr double kPlanckTimesLight = 6.62607015e-34 * 299792458;  // J m
  const double pupil_m = camera_pupil_m(rig);
  const double lumens = pupil_m * pupil_m / 4 / (rig.camera.fx * rig.camera.fy) * rig.camera_lens.transmission;
  return lumens * rig.projector_lens.wavelength_m / (kPlanckTimesLight * rig.projector_lens.efficacy_lm_w);
}

double projector_lux_at_1m(const RigModel& rig) {
  const Pinhole& p = rig.projector;
  constexpr int kGrid = 64;
  const auto row_of_points = [&](int i) {
    std::array<Eigen::Vector2d, kGrid + 1> points;
    for (int j = 0; j <= kGrid; ++j)
      points[static_cast<size_t>(j)] =
          p.undistort({p.width * i / double{kGrid} - 0.5, p.height * j / double{kGrid} - 0.5});
    return points;
  };
  double area = 0;  // on the plane z = 1 m, weighted by vignetting
  auto next = row_of_points(0);
  for (int i = 0; i < kGrid; ++i) {
    const auto here = next;
    next = row_of_points(i + 1);
    for (size_t j = 0; j < kGrid; ++j) {
      const Eigen::Vector2d &a = here[j], &b = next[j], &c = next[j + 1], &d = here[j + 1];
      const Eigen::Vector2d one = c - a, other = d - b;  // diagonals of the cell
      const double cell = 0.5 * std::abs(one.x() * other.y() - one.y() * other.x());
      const double r2 = (0.25 * (a + b + c + d)).squaredNorm();
      if (!std::isnan(r2)) area += cell * std::pow(1 + r2, -rig.projector_lens.vignetting / 2);
    }
  }
  return rig.projector_lens.flux_lm / area;
}

double white_electrons_at_1m(const RigModel& rig) {
  return projector_lux_at_1m(rig) * photons_per_lux_s(rig) * rig.timing.exposure_s * rig.sensor.quantum_efficiency;
}

}  // namespace fringeslam::sim

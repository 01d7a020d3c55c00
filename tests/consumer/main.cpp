// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

int main() {
  const auto sequence = fringeslam::phase_shift_sequence(1024, 768, {1040, 131}, 3, fringeslam::Axis::columns, 8);
  const auto six = fringeslam::six_dof(fringeslam::pose_from({{1, 2, 3}, {4, 5, 6}}));
  const bool fine = sequence.patterns.size() == 6 && (six.angles_deg - Eigen::Vector3d(4, 5, 6)).norm() < 1e-9 &&
                    fringeslam::sim::sphere_mesh(1, 1).triangles.size() == 80;
  return fine ? 0 : 1;
}

// SPDX-License-Identifier: Apache-2.0
// Views of analytic surfaces, ray cast exactly: what a perfect sensor (or one with known Gaussian
// depth noise) would measure.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"
#include "tests/support/random.h"

namespace fringeslam::support {

struct Hit {
  double distance = 0;  // along the direction as given
  Eigen::Vector3d point, normal;
};

// The first hit of a ray with a surface, in the surface's own (world) frame.
using Surface = std::function<std::optional<Hit>(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction)>;

// n.P = offset.
Surface plane(const Eigen::Vector3d& normal, double offset);
// The nearest hit of several surfaces.
Surface nearest_of(std::vector<Surface> surfaces);
// Three orthogonal planes that meet at `tip`, opening towards -z, each 54.7 degrees from the z axis.
Surface corner(const Eigen::Vector3d& tip);
// z = depth + height sin(2 pi x / period) sin(2 pi (y + 0.3 x) / period): bumps that fix all six degrees.
Surface bumps(double depth, double height, double period);

// 133 x 125 px camera, 1024 x 768 projector, 250 mm baseline, both optionally with lens distortion.
RigModel small_rig(bool distorted);

// Depth noise of standard deviation sigma_m is added along the rays when `noise` is given; normals are exact.
Frame observe(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_m,
              Random* noise = nullptr);

// The same view as truth.
TruthFrame truth_of(const Surface& surface, const RigModel& rig, const Pose& world_from_camera);

// Where in the projector each camera pixel's light came from, with noise of sigma_px when `noise` is given.
DecodedStack seen_columns(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_px,
                          Random* noise = nullptr);

}  // namespace fringeslam::support

// SPDX-License-Identifier: Apache-2.0
// Exact ray-cast views of analytic surfaces: the measurements of an ideal sensor or of one with known Gaussian depth
// noise.
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
  double distance = 0;  // in units of the direction's length
  Eigen::Vector3d point, normal;
};

// Returns the first hit of a ray with a surface, in the world frame.
using Surface = std::function<std::optional<Hit>(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction)>;

// Plane n.P = offset.
Surface plane(const Eigen::Vector3d& normal, double offset);
// Union of surfaces: the nearest hit.
Surface nearest_of(std::vector<Surface> surfaces);
// Three orthogonal planes that meet at `tip` and open towards -z; their normals are at 54.7 degrees to the z axis.
Surface corner(const Eigen::Vector3d& tip);
// z = depth + height sin(2 pi x / period) sin(2 pi (y + 0.3 x) / period): bumps that constrain all six degrees of
// freedom.
Surface bumps(double depth, double height, double period);

// Rig with a 133 x 125 px camera, a 1024 x 768 px projector and a 250 mm baseline, optionally with lens distortion in
// both.
RigModel small_rig(bool distorted);

// Renders a Frame. With `noise`, depth noise of standard deviation sigma_m is added along the rays; normals are exact.
Frame observe(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_m,
              Random* noise = nullptr);

// Gives a frame the texture of blobs of different brightness on the surface, which keypoints re-identify.
void print_texture(Frame& frame, const Pose& world_from_camera);

// Renders the ground truth of the same view.
TruthFrame truth_of(const Surface& surface, const RigModel& rig, const Pose& world_from_camera);

// Returns the decoded projector columns of a view; with `noise`, noise of sigma_px is added.
DecodedStack seen_columns(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_px,
                          Random* noise = nullptr);

}  // namespace fringeslam::support

// SPDX-License-Identifier: Apache-2.0
// From where a picture shows a scene best: what the views of its camera see, and the sensor that sees it.
#pragma once

#include <optional>
#include <vector>

#include "sim/preview/opened_world.h"

namespace fringeslam::sim {

// What a picture of the scene is of; world, m.
struct Interest {
  struct Spot {
    Eigen::Vector3d point, normal;  // the normal towards the camera that sees it
  };
  std::vector<Spot> spots;               // of surfaces that views see, not far beyond the rig's range
  std::vector<Eigen::Vector3d> devices;  // where the cameras stand, and the first view's projector
  std::vector<Eigen::Vector3d> corners;  // of the first view's images, where they fall on surfaces
  std::vector<Eigen::Vector3d> points() const;
  Box box() const;  // around all of them
};

// Evenly spread numbers of at most `most` of `count` views, the first one among them.
std::vector<size_t> some_views(size_t count, size_t most);

Pose world_from_camera(const Scene& scene, size_t view);
Pose world_from_projector(const Scene& scene, size_t view);

// The corners of a device's image at a depth, in its own frame, around the image.
std::vector<Eigen::Vector3d> image_corners(const Pinhole& device, double depth_m);

Interest interest_of(const Scene& scene, const RayWorld& world);

struct Viewpoint {
  Pinhole camera;
  Pose world_from_camera;
  double interest_m = 1;                          // diagonal of the box around the interest
  std::optional<Box> window;                      // through which the world must be opened (sim/preview/opened_world.h)
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // the side of the world from which the picture is taken
};

// The direction from which most of the interest is to be seen, from above if it can be, and the place from which it
// fills a picture of that size.
Viewpoint choose_viewpoint(const Scene& scene, const RayWorld& world, const Interest& interest, int width, int height);

}  // namespace fringeslam::sim

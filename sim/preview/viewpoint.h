// SPDX-License-Identifier: Apache-2.0
// Selects the viewpoint that best shows a scene: the surfaces seen along the trajectory, and the rig itself.
#pragma once

#include <optional>
#include <vector>

#include "sim/preview/cutaway_scene.h"

namespace fringeslam::sim {

// Region of interest of the overview; world, m.
struct Interest {
  struct Spot {
    Eigen::Vector3d point, normal;  // the normal points towards the camera that sees it
  };
  std::vector<Spot> spots;               // seen along the trajectory, up to slightly beyond the rig's range
  std::vector<Eigen::Vector3d> devices;  // camera positions, and the first view's projector
  std::vector<Eigen::Vector3d> corners;  // corners of the first view's camera and projector images on surfaces
  std::vector<Eigen::Vector3d> points() const;
  Box box() const;  // bounding box of points()
};

// Returns the indices of at most `most` evenly spaced views out of `count`, including the first.
std::vector<size_t> some_views(size_t count, size_t most);

Pose world_from_camera(const Scene& scene, size_t view);
Pose world_from_projector(const Scene& scene, size_t view);

// Returns the corners of a device's image at a given depth, in the device frame, in cyclic order.
std::vector<Eigen::Vector3d> image_corners(const Pinhole& device, double depth_m);

// Collects the region of interest of a scene.
Interest interest_of(const Scene& scene, const RayScene& world);

struct Viewpoint {
  Pinhole camera;
  Pose world_from_camera;
  double interest_m = 1;                          // diagonal of the interest's bounding box
  std::optional<Box> window;                      // cutaway box, if needed (sim/preview/cutaway_scene.h)
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // +z, or -z if the scene is viewed from below
};

// Chooses the direction from which most of the interest is visible, preferably from above, and the position from which
// the interest fills an image of the given size, px.
Viewpoint choose_viewpoint(const Scene& scene, const RayScene& world, const Interest& interest, int width, int height);

}  // namespace fringeslam::sim

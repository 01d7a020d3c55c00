// SPDX-License-Identifier: Apache-2.0
// A scene as the data of its page (tools/report/page/src/world).
#pragma once

#include <map>
#include <string>

#include "sim/scene/scene.h"

namespace fringeslam::tools {

struct SceneData {
  // JSON object:
  //   name, seed, notes, triangles, drawn_triangles
  //   continuous  true if the path lists equal time steps of a continuous motion; otherwise it lists views
  //   rig         near_m, far_m, camera's width_px and height_px, and the rays (x, y at depth 1) of the corners of both
  //               images
  //   patterns    what each image of a stack shows
  //   pictures    names of the SensorPictures that show anything
  //   temperature_c  coldest and warmest surface
  //   objects     name, place (file:line), path of its entry or "", name of its mesh, material, mean albedo, number of its
  //               tile (-1: none), pose
  //   tiles       SurfaceTiles of the materials: name of the picture, size_m, scale, centered, edge
  //   values      path, text, distribution (empty: none), place, low and high (null: unlimited, or not a number), whole,
  //               changeable
  //   path        time_s, poses of camera and projector
  // Poses are x y z qx qy qz qw in the world frame.
  std::string json;
  // By name, the hash of the content, so that a page keeps what it has. Each mesh: numbers of vertices and triangles and
  // whether there are texture coordinates (uint32), positions (float32, m, object frame), indices (uint32), texture
  // coordinates (float32), in this computer's byte order.
  std::map<std::string, std::string> meshes;
  std::map<std::string, std::string> tiles;  // the same: PNG
  Trajectory path;                           // of the robot, at the places of the path
};

// If the world's objects have more than `max_triangles` in total, meshes of more than 500 vertices are thinned by vertex
// clustering, each by that ratio. Smaller ones stay whole, so that a world of many small objects may exceed it.
// Lists all drawn ones of `values`, the coordinates of what can be dragged, and the first kMostNumbers others.
constexpr size_t kMostNumbers = 2000;
SceneData scene_data(const sim::Scene& scene, const std::vector<sim::SceneValue>& values = {},
                     size_t max_triangles = 1'500'000);

}  // namespace fringeslam::tools

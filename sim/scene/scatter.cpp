// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scatter.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "sim/random.h"
#include "sim/scene/draw_item.h"

namespace fringeslam::sim {

namespace {

// Upright bounding cuboid of an object: centre, half sizes along its own axes, yaw.
struct Footprint {
  double x = 0, y = 0, half_x = 0, half_y = 0, yaw = 0;
  double top = 0;
  bool flat_top = false;
  Eigen::Vector2d axes[2] = {};
  double reach = 0;  // bounding radius about the centre

  // Precomputes axes and reach; to be called once the other members are set.
  void measure() {
    axes[0] = {std::cos(yaw), std::sin(yaw)}, axes[1] = {-std::sin(yaw), std::cos(yaw)};
    reach = 1.000001 * std::hypot(half_x, half_y);
  }
  bool far_from(const Footprint& other) const {
    const double dx = other.x - x, dy = other.y - y, reaches = reach + other.reach;
    return dx * dx + dy * dy > reaches * reaches;
  }
  const Eigen::Vector2d& axis(int i) const { return axes[i]; }
  double extent_along(const Eigen::Vector2d& direction) const {
    return half_x * std::abs(axis(0).dot(direction)) + half_y * std::abs(axis(1).dot(direction));
  }
};

// True if two rectangles overlap (separating axis test).
bool overlap(const Footprint& a, const Footprint& b) {
  const Eigen::Vector2d between(b.x - a.x, b.y - a.y);
  for (const Footprint* f : {&a, &b}) {
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector2d axis = f->axis(i);
      if (std::abs(between.dot(axis)) >= a.extent_along(axis) + b.extent_along(axis)) return false;
    }
  }
  return true;
}

bool inside(const Footprint& inner, const Footprint& outer) {
  const Eigen::Vector2d between(inner.x - outer.x, inner.y - outer.y);
  return std::abs(between.dot(outer.axis(0))) + inner.extent_along(outer.axis(0)) <= outer.half_x &&
         std::abs(between.dot(outer.axis(1))) + inner.extent_along(outer.axis(1)) <= outer.half_y;
}

// Returns the height at which the footprint can rest: 0 on the ground if it overlaps nothing, the height of a flat top
// if it lies entirely on it and overlaps nothing higher; negative if neither is possible.
double rest_height(const Footprint& candidate, const std::vector<Footprint>& placed) {
  double height = 0;
  for (const Footprint& other : placed) {
    if (other.flat_top && !candidate.far_from(other) && inside(candidate, other)) height = std::max(height, other.top);
  }
  for (const Footprint& other : placed) {
    if (other.top > height && !candidate.far_from(other) && overlap(candidate, other)) return -1;
  }
  return height;
}

Mesh make_mesh(Shape shape, const Eigen::Vector3d& size, uint32_t seed) {
  switch (shape) {
    case Shape::cylinder:
      return cylinder_mesh(size.x() / 2, size.z(), 64);
    case Shape::sphere:
      return sphere_mesh(size.x() / 2, 4);
    case Shape::rock:
      return rock_mesh(size, 4, 0.25, seed);
    default:
      return box_mesh(size);
  }
}

// Gives cylinders a round base, and spheres one diameter.
Eigen::Vector3d round_size(Shape shape, Eigen::Vector3d size) {
  if (shape == Shape::cylinder || shape == Shape::sphere) size.y() = size.x();
  if (shape == Shape::sphere) size.z() = size.x();
  return size;
}

}  // namespace

const ScatterShapes::Variant& ScatterShapes::variant(const ScatterItem& item, size_t kind, uint32_t number) {
  Variant& variant = variants_[{kind, number}];
  if (!variant.mesh) {
    Philox random(seed_, Stream::shape, generator_, static_cast<uint32_t>(kind * 1000003 + number));
    variant.size = round_size(item.shape, draw_size(item, random));
    variant.mesh = std::make_shared<const Mesh>(make_mesh(item.shape, variant.size, random.seed()));
  }
  return variant;
}

std::vector<Object> scatter_objects(const Scatter& scatter, uint64_t seed, uint32_t generator, ScatterShapes* shapes) {
  ScatterShapes own(seed, generator);
  Philox random(seed, Stream::placement, generator);
  std::vector<Object> objects;
  std::vector<Footprint> placed;
  constexpr int kTriesPerObject = 60;
  for (int n = 0; n < scatter.count; ++n) {
    const size_t kind = draw_item(scatter.items, random);
    const ScatterItem& item = scatter.items[kind];
    Eigen::Vector3d size = round_size(item.shape, draw_size(item, random));
    const uint32_t shape_seed = random.seed();
    std::shared_ptr<const Mesh> mesh;
    if (item.variants > 0) {
      const auto variant = static_cast<uint32_t>(random.uniform() * item.variants);
      const ScatterShapes::Variant& shape = (shapes ? *shapes : own).variant(item, kind, variant);
      size = shape.size;
      mesh = shape.mesh;
    }

    for (int attempt = 0; attempt < kTriesPerObject; ++attempt) {
      Footprint f;
      f.x = random.uniform(-0.5, 0.5) * scatter.area_x;
      f.y = random.uniform(-0.5, 0.5) * scatter.area_y;
      f.yaw = random.uniform(0, 2 * std::numbers::pi);
      f.half_x = size.x() / 2;
      f.half_y = size.y() / 2;
      f.flat_top = item.shape == Shape::box || item.shape == Shape::cylinder;
      // Noise may extend a rock beyond its nominal size.
      if (item.shape == Shape::rock) f.half_x *= 1.25, f.half_y *= 1.25;
      f.measure();
      const double base = rest_height(f, placed);
      if (base < 0 || base + size.z() > scatter.max_height) continue;
      f.top = base + size.z();
      placed.push_back(f);
      Object object;
      object.mesh = mesh ? mesh : std::make_shared<const Mesh>(make_mesh(item.shape, size, shape_seed));
      object.material = item.material;
      object.texture_seed = shape_seed;
      // Rocks sink slightly into their support.
      const double sink = item.shape == Shape::rock ? 0.1 * size.z() : 0;
      object.world_from_object =
          scatter.world_from_area * Pose{rotation_exp({0, 0, f.yaw}), {f.x, f.y, base + size.z() / 2 - sink}};
      objects.push_back(std::move(object));
      break;
    }
  }
  return objects;
}

}  // namespace fringeslam::sim

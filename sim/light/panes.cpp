// SPDX-License-Identifier: Apache-2.0
#include "sim/light/panes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/types/error.h"

namespace fringeslam::sim {

double sheet_reflectance(double face_reflectance, double cosine) {
  const double amplitude = std::sqrt(face_reflectance), index = (1 + amplitude) / (1 - amplitude);
  const double c = std::min(1.0, std::abs(cosine)), inside = std::sqrt(1 - (1 - c * c) / (index * index));
  double sum = 0;
  for (const double ratio :
       {(c - index * inside) / (c + index * inside), (index * c - inside) / (index * c + inside)}) {
    const double face = ratio * ratio;
    sum += 2 * face / (1 + face);
  }
  return sum / 2;
}

Panes::Panes(const Scene& scene) {
  for (const Object& object : scene.objects) {
    if (!object.material.pane) continue;
    for (const Eigen::Vector3i& triangle : object.mesh->triangles) {
      const auto vertex = [&](int i) -> Eigen::Vector3d {
        return object.world_from_object * object.mesh->vertices[static_cast<size_t>(triangle[i])];
      };
      const Eigen::Vector3d corner = vertex(0), edge1 = vertex(1) - corner, edge2 = vertex(2) - corner;
      sheets_.push_back({corner, edge1, edge2, edge1.cross(edge2).normalized(), object.material.reflectance});
      if (sheets_.size() > kMostTriangles)
        throw Error(object.place + ": " + object.name + ": the panes of a scene may have " +
                    std::to_string(kMostTriangles) + " triangles; use shape plane for each pane");
    }
  }
}

std::optional<Panes::Crossing> Panes::crossing(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                               int triangle) const {
  const Sheet& sheet = sheets_[static_cast<size_t>(triangle)];
  const Eigen::Vector3d p = direction.cross(sheet.edge2);
  const double determinant = sheet.edge1.dot(p);
  if (determinant == 0) return std::nullopt;
  const Eigen::Vector3d from_corner = origin - sheet.corner;
  const double u = from_corner.dot(p) / determinant;
  if (!(u >= 0 && u <= 1)) return std::nullopt;
  const Eigen::Vector3d q = from_corner.cross(sheet.edge1);
  const double v = direction.dot(q) / determinant;
  if (!(v >= 0 && u + v <= 1)) return std::nullopt;
  const double cosine = direction.dot(sheet.normal) / direction.norm();
  return Crossing{sheet.edge2.dot(q) / determinant, triangle, sheet_reflectance(sheet.face_reflectance, cosine)};
}

// Calls `visit` for the crossings strictly between the ends, in the order of the triangles. A ray through the common edge of
// a plane's triangles crosses it once.
template <class Visit>
void Panes::visit_crossings(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double distance,
                            int except, const Visit& visit) const {
  constexpr double kSame = 1e-9;
  double last = -1;
  for (int i = 0; i < count(); ++i) {
    if (i == except) continue;
    const std::optional<Crossing> one = crossing(origin, direction, i);
    if (!one || one->distance <= kSame || one->distance >= distance * (1 - kSame)) continue;
    if (std::abs(one->distance - last) <= kSame * last) continue;
    last = one->distance;
    visit(*one);
  }
}

std::vector<Panes::Crossing> Panes::crossings(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                              double distance) const {
  std::vector<Crossing> all;
  visit_crossings(origin, direction, distance, kNone, [&](const Crossing& one) { all.push_back(one); });
  std::sort(all.begin(), all.end(), [](const Crossing& a, const Crossing& b) { return a.distance < b.distance; });
  return all;
}

std::optional<Panes::Crossing> Panes::crossing_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                                                       int triangle) const {
  std::optional<Crossing> found;
  visit_crossings(from, to - from, 1, kNone, [&](const Crossing& one) {
    if (one.triangle == triangle) found = one;
  });
  return found;
}

double Panes::passed(const Eigen::Vector3d& from, const Eigen::Vector3d& to, int except) const {
  double share = 1;
  visit_crossings(from, to - from, 1, except, [&](const Crossing& one) { share *= 1 - one.reflected; });
  return share;
}

Panes::Mirrored Panes::mirrored(const Eigen::Vector3d& point, int triangle) const {
  const Sheet& sheet = sheets_[static_cast<size_t>(triangle)];
  const double height = (point - sheet.corner).dot(sheet.normal);
  return {point - 2 * height * sheet.normal, height};
}

}  // namespace fringeslam::sim

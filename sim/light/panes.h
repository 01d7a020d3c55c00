// SPDX-License-Identifier: Apache-2.0
// Thin panes of clear glass (docs/method.md, section 12.1). A pane is a sheet without absorption: light that is reflected
// between its faces adds up, so that with the Fresnel reflectance r of one face, per polarization,
//
//   R = 2 r / (1 + r),   T = 1 - R.
//
// Refraction shifts rays by less than the thickness, which is neglected. Rays pass panes in the scene's BVH.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

// Returns the share of unpolarized light that a sheet reflects, by the reflectance of a face at normal incidence and the
// cosine of the angle of incidence.
double sheet_reflectance(double face_reflectance, double cosine);

class Panes {
 public:
  // Throws Error if the panes of the scene have more than kMostTriangles triangles.
  explicit Panes(const Scene& scene);

  static constexpr size_t kMostTriangles = 64;
  static constexpr int kNone = -1;

  bool empty() const { return sheets_.empty(); }
  int count() const { return static_cast<int>(sheets_.size()); }

  // A ray's passage through a triangle of a pane.
  struct Crossing {
    double distance = 0;  // in units of the direction's length
    int triangle = kNone;
    double reflected = 0;  // share of the light
  };
  // Returns the crossings between the origin and a distance, the nearest first.
  std::vector<Crossing> crossings(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                  double distance) const;

  // Returns the crossing of a triangle between two points, if any.
  std::optional<Crossing> crossing_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to, int triangle) const;

  // Returns the share of light that all panes between two points let pass; the triangle `except` is left out.
  double passed(const Eigen::Vector3d& from, const Eigen::Vector3d& to, int except = kNone) const;

  // Unit normal of a triangle.
  const Eigen::Vector3d& normal(int triangle) const { return sheets_[static_cast<size_t>(triangle)].normal; }

  // Mirror image of a point, and the signed distance of the point from the triangle's plane.
  struct Mirrored {
    Eigen::Vector3d point;
    double height;
  };
  Mirrored mirrored(const Eigen::Vector3d& point, int triangle) const;

 private:
  struct Sheet {
    Eigen::Vector3d corner, edge1, edge2, normal;
    double face_reflectance;
  };
  std::optional<Crossing> crossing(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, int triangle) const;
  template <class Visit>
  void visit_crossings(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double distance, int except,
                       const Visit& visit) const;
  std::vector<Sheet> sheets_;
};

}  // namespace fringeslam::sim

// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mass_properties.h"

#include <LinearMath/btConvexHullComputer.h>

#include <Eigen/Geometry>
#include <cmath>

namespace fringeslam::sim {

MassProperties mass_properties_of(const std::vector<Eigen::Vector3d>& corners) {
  constexpr double kUnit = 0.1;  // m; scales lengths to about one, as Bullet's single precision requires
  std::vector<btVector3> points;
  for (const Eigen::Vector3d& corner : corners) {
    const Eigen::Vector3d p = corner / kUnit;
    points.emplace_back(static_cast<btScalar>(p.x()), static_cast<btScalar>(p.y()), static_cast<btScalar>(p.z()));
  }
  btConvexHullComputer computer;
  computer.compute(&points[0].x(), sizeof(btVector3), static_cast<int>(points.size()), 0, 0);
  MassProperties bulk;
  const auto vertex = [&](int i) {
    const btVector3& v = computer.vertices[i];
    return Eigen::Vector3d(
        kUnit * Eigen::Vector3d(static_cast<double>(v.x()), static_cast<double>(v.y()), static_cast<double>(v.z())));
  };
  const Eigen::Vector3d inside = corners.front();
  for (int f = 0; f < computer.faces.size(); ++f) {
    const btConvexHullComputer::Edge* first = &computer.edges[computer.faces[f]];
    const Eigen::Vector3d a = vertex(first->getSourceVertex()) - inside;
    for (const auto* e = first->getNextEdgeOfFace(); e->getTargetVertex() != first->getSourceVertex();
         e = e->getNextEdgeOfFace()) {
      const Eigen::Vector3d b = vertex(e->getSourceVertex()) - inside, c = vertex(e->getTargetVertex()) - inside;
      const double volume = std::abs(a.dot(b.cross(c))) / 6;
      bulk.volume += volume;
      bulk.centre += volume * (inside + (a + b + c) / 4);
    }
  }
  if (bulk.volume > 0) bulk.centre /= bulk.volume;
  return bulk;
}

}  // namespace fringeslam::sim

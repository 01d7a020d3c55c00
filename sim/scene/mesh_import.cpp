// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh_import.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "core/types/error.h"
#include "sim/scene/mesh_reader.h"

namespace fringeslam::sim {

namespace {

// Our z from the file's up axis, x kept where it can be.
Eigen::Matrix3d ours_from_file(const std::string& up) {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  if (up == "y") rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  if (up == "x") rotation << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  return rotation;
}

std::string label(const RawInstance& instance, const RawMesh& mesh) {
  return "'" + (instance.name.empty() ? mesh.name : instance.name) + "'";
}

void check_mesh(const std::filesystem::path& file, const RawModel& model, const RawMesh& mesh) {
  const size_t vertices = mesh.positions.size() / 3;
  const auto beyond = std::find_if(mesh.indices.begin(), mesh.indices.end(), [&](uint32_t i) { return i >= vertices; });
  if (beyond != mesh.indices.end())
    throw Error(file.string() + ": mesh '" + mesh.name + "' has a triangle with vertex " + std::to_string(*beyond) +
                ", but only " + std::to_string(vertices) + " vertices; the file is broken");
  const auto odd =
      std::find_if(mesh.positions.begin(), mesh.positions.end(), [](float x) { return !std::isfinite(x); });
  if (odd != mesh.positions.end())
    throw Error(file.string() + ": vertex " + std::to_string((odd - mesh.positions.begin()) / 3) + " of mesh '" +
                mesh.name + "' is not finite; the file is broken");
  if (mesh.material >= model.materials.size() && !model.materials.empty())
    throw Error(file.string() + ": mesh '" + mesh.name + "' names material " + std::to_string(mesh.material) + " of " +
                std::to_string(model.materials.size()));
}

// Triangles of an instance with an area, in our frame.
ImportedPart part_of(const RawMesh& mesh, const Eigen::Affine3d& ours_from_mesh, size_t& degenerate) {
  ImportedPart part;
  const bool mapped = mesh.coordinates.size() / 2 == mesh.positions.size() / 3;
  for (size_t i = 0; i + 2 < mesh.positions.size(); i += 3)
    part.mesh.vertices.push_back(
        ours_from_mesh *
        Eigen::Vector3f(mesh.positions[i], mesh.positions[i + 1], mesh.positions[i + 2]).cast<double>());
  if (mapped) {
    for (size_t i = 0; i + 1 < mesh.coordinates.size(); i += 2)
      part.mesh.texture_coordinates.emplace_back(mesh.coordinates[i], mesh.coordinates[i + 1]);
  }
  // A mirrored instance turns its triangles inside out.
  const bool mirrored = ours_from_mesh.linear().determinant() < 0;
  for (size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    Eigen::Vector3i t(static_cast<int>(mesh.indices[i]), static_cast<int>(mesh.indices[i + 1]),
                      static_cast<int>(mesh.indices[i + 2]));
    if (mirrored) std::swap(t[1], t[2]);
    const Eigen::Vector3d& a = part.mesh.vertices[static_cast<size_t>(t[0])];
    const Eigen::Vector3d ab = part.mesh.vertices[static_cast<size_t>(t[1])] - a,
                          ac = part.mesh.vertices[static_cast<size_t>(t[2])] - a;
    const double area = ab.cross(ac).norm();
    if (!(area > 1e-12 * ab.norm() * ac.norm()) || area == 0) {
      ++degenerate;
      continue;
    }
    part.mesh.triangles.push_back(t);
  }
  return part;
}

}  // namespace

std::string MeshImport::summary(const std::filesystem::path& file) const {
  const Eigen::Vector3d size = high - low;
  char text[256];
  std::snprintf(text, sizeof text, "%g m a unit, %s up; %zu part%s, %zu triangles%s, %.4g x %.4g x %.4g m", unit_m,
                up.c_str(), parts.size(), parts.size() == 1 ? "" : "s", triangles,
                degenerate == 0 ? "" : (" (" + std::to_string(degenerate) + " degenerate ones dropped)").c_str(),
                size.x(), size.y(), size.z());
  return file.filename().string() + ": " + text;
}

MeshImport import_mesh(const std::filesystem::path& file, const MeshImportOptions& options) {
  if (!std::filesystem::is_regular_file(file)) throw Error(file.string() + ": is no file");
  const RawModel model = read_model(file, options.time_limit_s, options.memory_limit_gib);
  for (const RawMesh& mesh : model.meshes) check_mesh(file, model, mesh);
  MeshImport result;
  result.unit_m = options.unit_m.value_or(model.unit_m > 0 ? model.unit_m : 1);
  result.up = options.up.value_or(model.y_up ? "y" : "z");
  const Eigen::Matrix3d turned = ours_from_file(result.up);
  result.low.setConstant(std::numeric_limits<double>::infinity());
  result.high = -result.low;
  for (const RawInstance& instance : model.instances) {
    if (instance.mesh >= model.meshes.size())
      throw Error(file.string() + ": node '" + instance.name + "' shows a mesh that is not there");
    const RawMesh& mesh = model.meshes[instance.mesh];
    Eigen::Matrix4d transform =
        Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(instance.transform.data());
    if (!transform.allFinite())
      throw Error(file.string() + ": the transform of " + label(instance, mesh) + " is not finite");
    Eigen::Affine3d ours_from_mesh;
    ours_from_mesh.linear() = result.unit_m * turned * transform.topLeftCorner<3, 3>();
    ours_from_mesh.translation() = result.unit_m * turned * transform.topRightCorner<3, 1>();
    ImportedPart part = part_of(mesh, ours_from_mesh, result.degenerate);
    if (part.mesh.triangles.empty()) continue;
    part.name = instance.name.empty() ? mesh.name : instance.name;
    if (mesh.material < model.materials.size()) {
      const RawMaterial& material = model.materials[mesh.material];
      part.material = material.name;
      part.albedo = std::clamp(0.2126 * static_cast<double>(material.colour[0]) +
                                   0.7152 * static_cast<double>(material.colour[1]) +
                                   0.0722 * static_cast<double>(material.colour[2]),
                               0.0, 1.0);
      // Textures inside the file, named *0, are not read.
      if (!material.texture.empty() && material.texture[0] != '*') part.texture = file.parent_path() / material.texture;
    }
    for (const Eigen::Vector3d& v : part.mesh.vertices)
      result.low = result.low.cwiseMin(v), result.high = result.high.cwiseMax(v);
    result.triangles += part.mesh.triangles.size();
    result.parts.push_back(std::move(part));
  }
  if (result.parts.empty()) throw Error(file.string() + ": holds no triangle with an area");
  return result;
}

}  // namespace fringeslam::sim

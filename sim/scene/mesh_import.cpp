// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh_import.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string_view>

#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "sim/scene/cache.h"
#include "sim/scene/mesh_reader.h"
#include "sim/scene/uri.h"

namespace fringeslam::sim {

namespace {

// Returns the rotation that maps the file's up axis to z, keeping x unless x is up.
Eigen::Matrix3d world_from_file_axes(UpAxis up) {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  if (up == UpAxis::y) rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  if (up == UpAxis::x) rotation << 0, 1, 0, 0, 0, 1, 1, 0, 0;
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
    throw Error(file.string() + ": mesh '" + mesh.name + "' refers to material " + std::to_string(mesh.material) +
                ", but the file has only " + std::to_string(model.materials.size()));
}

// Refuses a file whose nodes would take hours or exhaust memory, before the work.
void check_nodes(const std::filesystem::path& file, const RawModel& model) {
  uint64_t vertices = 0, triangles = 0;
  for (const RawInstance& instance : model.instances) {
    if (instance.mesh >= model.meshes.size())
      throw Error(file.string() + ": node '" + instance.name + "' refers to a mesh that does not exist");
    vertices += model.meshes[instance.mesh].positions.size() / 3;
    triangles += model.meshes[instance.mesh].indices.size() / 3;
  }
  if (std::max(vertices, triangles) > kMostVerticesOfNodes)
    throw Error(file.string() + ": its nodes have " + std::to_string(vertices) + " vertices and " +
                std::to_string(triangles) + " triangles; at most " + std::to_string(kMostVerticesOfNodes) +
                " of each are read: divide it, or use its meshes in fewer nodes");
}

// Polar decomposition x -> rotation * (stretch * x) + translation; the rotation is proper, `stretch` may reflect.
struct Decomposed {
  Eigen::Matrix3d stretch;
  Pose pose;
};

Decomposed decomposed(const Eigen::Affine3d& transform) {
  Eigen::Matrix3d rotation = nearest_orthogonal(transform.linear());
  if (rotation.determinant() < 0) rotation = -rotation;
  return {rotation.transpose() * transform.linear(), {rotation, transform.translation()}};
}

// A mesh of the file at one scale, possibly shared by several nodes.
struct ScaledMesh {
  Eigen::Matrix3d stretch;
  std::shared_ptr<const Mesh> mesh;
  size_t degenerate = 0;
};

// Applies `stretch` to the raw mesh and drops degenerate triangles.
ScaledMesh stretched(const RawMesh& raw, const Eigen::Matrix3d& stretch) {
  Mesh mesh;
  mesh.vertices.reserve(raw.positions.size() / 3);
  mesh.triangles.reserve(raw.indices.size() / 3);
  for (size_t i = 0; i + 2 < raw.positions.size(); i += 3)
    mesh.vertices.push_back(
        stretch * Eigen::Vector3f(raw.positions[i], raw.positions[i + 1], raw.positions[i + 2]).cast<double>());
  if (raw.coordinates.size() / 2 == raw.positions.size() / 3) {
    mesh.texture_coordinates.reserve(raw.coordinates.size() / 2);
    // Programs that unwrap meshes leave NaN at degenerate triangles.
    const auto finite = [](float value) { return std::isfinite(value) ? value : 0; };
    for (size_t i = 0; i + 1 < raw.coordinates.size(); i += 2)
      mesh.texture_coordinates.emplace_back(finite(raw.coordinates[i]), finite(raw.coordinates[i + 1]));
  }
  ScaledMesh result{stretch, nullptr};
  // Mirroring reverses the orientation of the triangles.
  const bool mirrored = stretch.determinant() < 0;
  for (size_t i = 0; i + 2 < raw.indices.size(); i += 3) {
    Eigen::Vector3i t(static_cast<int>(raw.indices[i]), static_cast<int>(raw.indices[i + 1]),
                      static_cast<int>(raw.indices[i + 2]));
    if (mirrored) std::swap(t[1], t[2]);
    const Eigen::Vector3d& a = mesh.vertices[static_cast<size_t>(t[0])];
    const Eigen::Vector3d ab = mesh.vertices[static_cast<size_t>(t[1])] - a,
                          ac = mesh.vertices[static_cast<size_t>(t[2])] - a;
    const double area = ab.cross(ac).norm();
    if (area > 1e-12 * ab.norm() * ac.norm() && area > 0)
      mesh.triangles.push_back(t);
    else
      ++result.degenerate;
  }
  result.mesh = std::make_shared<const Mesh>(std::move(mesh));
  return result;
}

// Memory that stretched() takes for its result.
size_t stretched_bytes(const RawMesh& raw) {
  return sizeof(Mesh) + sizeof(ScaledMesh) + raw.positions.size() / 3 * sizeof(Eigen::Vector3d) +
         raw.coordinates.size() / 2 * sizeof(Eigen::Vector2f) + raw.indices.size() / 3 * sizeof(Eigen::Vector3i);
}

// A mesh of the file at all its scales.
class Scales {
 public:
  // Returns the mesh at this scale, or nullptr. Scales that differ only by rounding are shared.
  const ScaledMesh* find(const Eigen::Matrix3d& stretch) const {
    constexpr double kRounding = 1e-6;
    constexpr int kMostCompared = 100;  // a file can have very many scales of almost the same sum
    const double rounding = kRounding * stretch.norm(), reach = rounding * weights().norm(), sum = sum_of(stretch);
    int compared = 0;
    for (auto scale = scales_.lower_bound(sum - reach);
         scale != scales_.end() && scale->first <= sum + reach && compared < kMostCompared; ++scale, ++compared) {
      if ((scale->second.stretch - stretch).norm() <= rounding) return &scale->second;
    }
    return nullptr;
  }
  const ScaledMesh& add(const RawMesh& raw, const Eigen::Matrix3d& stretch) {
    return scales_.emplace(sum_of(stretch), stretched(raw, stretch))->second;
  }
  size_t size() const { return scales_.size(); }

 private:
  // In the sum that orders the scales, no two elements weigh the same: many files have equal scales along different axes.
  static Eigen::Matrix3d weights() {
    return (Eigen::Matrix3d() << 0.31, 0.17, 0.43, 0.29, 0.71, 0.13, 0.59, 0.23, 0.97).finished();
  }
  static double sum_of(const Eigen::Matrix3d& stretch) { return stretch.cwiseProduct(weights()).sum(); }

  std::multimap<double, ScaledMesh> scales_;
};

// Writes an image embedded in the file to the cache and returns its path.
std::filesystem::path unpacked(const std::filesystem::path& file, const RawTexture& texture) {
  std::string bytes(texture.bytes.begin(), texture.bytes.end());
  std::string extension = texture.format.empty() ? "ppm" : texture.format;
  if (!std::all_of(extension.begin(), extension.end(), [](unsigned char c) { return std::isalnum(c); }))
    throw Error(file.string() + ": an embedded image has an unknown format");
  if (texture.format.empty()) {
    bytes = "P6\n" + std::to_string(texture.width) + " " +
            std::to_string(texture.width == 0 ? 0 : texture.bytes.size() / 4 / texture.width) + "\n255\n";
    for (size_t i = 0; i + 3 < texture.bytes.size(); i += 4) {
      for (const size_t channel : {2, 1, 0}) bytes += static_cast<char>(texture.bytes[i + channel]);
    }
  }
  return cached_file("textures/" + content_hash(bytes) + "." + extension, bytes);
}

// Returns the image file that a mesh names. Programs on other systems write backslashes and their own absolute paths, and
// some keep images in folders of their own, such as Gazebo's ../materials/textures.
std::filesystem::path texture_beside(const std::filesystem::path& file, std::string name) {
  constexpr std::string_view kScheme = "file://";
  if (name.starts_with(kScheme)) name.erase(0, kScheme.size());
  std::replace(name.begin(), name.end(), '\\', '/');
  const std::filesystem::path folder = file.parent_path();
  std::error_code unknown;
  // glTF names files by URIs.
  for (const std::string& spelled : {name, percent_decoded(name)}) {
    const std::filesystem::path own = std::filesystem::path(spelled).filename();
    for (const std::filesystem::path& candidate :
         {folder / spelled, folder / own, folder / "textures" / own, folder / "../materials/textures" / own,
          folder / "../textures" / own}) {
      if (std::filesystem::exists(candidate, unknown)) return candidate;
    }
  }
  return folder / name;
}

// Resolves a material's texture name: a file, or *N for the Nth embedded image; empty for none.
std::filesystem::path texture_file(const std::filesystem::path& file, const RawModel& model, const std::string& name) {
  if (name.empty()) return {};
  if (name[0] != '*') return texture_beside(file, name);
  size_t number = model.textures.size();
  std::from_chars(name.data() + 1, name.data() + name.size(), number);
  if (number >= model.textures.size()) throw Error(file.string() + ": has no image " + name + " embedded");
  return unpacked(file, model.textures[number]);
}

}  // namespace

namespace {

// Sizes beyond these are mistakes of the unit or damaged numbers; nothing could be rendered.
void check_extent(const std::filesystem::path& file, const MeshImport& mesh) {
  constexpr double kSmallest_m = 1e-5, kLargest_m = 1e5;
  const double extent_m = (mesh.high - mesh.low).maxCoeff();
  const double farthest_m = std::max(mesh.high.cwiseAbs().maxCoeff(), mesh.low.cwiseAbs().maxCoeff());
  if (extent_m >= kSmallest_m && farthest_m <= kLargest_m) return;
  char text[200];
  std::snprintf(
      text, sizeof text,
      ": is %.3g m in size and up to %.3g m from its origin; a size from 1e-5 m and positions up to 1e5 m are "
      "read: state its unit with unit_m, or repair it",
      extent_m, farthest_m);
  throw Error(file.string() + text);
}

}  // namespace

std::string MeshImport::summary(const std::filesystem::path& file) const {
  const Eigen::Vector3d size = high - low;
  char text[256];
  std::snprintf(text, sizeof text, "unit %g m, %s up; %zu part%s%s, %zu triangles%s, %.4g x %.4g x %.4g m", unit_m,
                to_string(up), parts.size(), parts.size() == 1 ? "" : "s",
                meshes == parts.size() ? "" : (" of " + std::to_string(meshes) + " meshes").c_str(), triangles,
                degenerate == 0 ? "" : (" (" + std::to_string(degenerate) + " degenerate dropped)").c_str(), size.x(),
                size.y(), size.z());
  return file.filename().string() + ": " + text;
}

MeshImport import_mesh(const std::filesystem::path& file, const MeshImportOptions& options) {
  return import_model(file, read_model(file, options.time_limit_s, options.memory_limit_gib), options);
}

MeshImport import_model(const std::filesystem::path& file, const RawModel& model, const MeshImportOptions& options) {
  for (const RawMesh& mesh : model.meshes) check_mesh(file, model, mesh);
  check_nodes(file, model);
  MeshImport result;
  for (const RawFile& read : model.files) result.files.insert(read.path);
  result.unit_m = options.unit_m.value_or(model.unit_m > 0 ? model.unit_m : 1);
  result.up = options.up.value_or(model.y_up ? UpAxis::y : UpAxis::z);
  const Eigen::Matrix3d turned = world_from_file_axes(result.up);
  result.low.setConstant(std::numeric_limits<double>::infinity());
  result.high = -result.low;
  double taken_mib = 0;
  const auto take = [&](size_t bytes) {
    const double most_mib = 1024 * options.memory_limit_gib;
    taken_mib += static_cast<double>(bytes) / (1 << 20);
    if (taken_mib > most_mib)
      throw Error(file.string() + ": its nodes, and its meshes at all their scales, need more than " +
                  std::to_string(static_cast<int>(most_mib)) + " MiB of memory; it is damaged, or has to be divided");
  };
  std::map<std::string, std::filesystem::path> textures;  // by their names in the file
  const auto texture_of = [&](const RawMaterial& material) {
    const auto [texture, is_new] = textures.try_emplace(material.texture);
    if (is_new) {
      texture->second = texture_file(file, model, material.texture);
      if (!material.texture.empty() && material.texture[0] != '*') result.files.insert(texture->second);
    }
    return texture->second;
  };
  size_t scaled_triangles = 0;
  std::vector<Scales> scales(model.meshes.size());
  for (const RawInstance& instance : model.instances) {
    const RawMesh& mesh = model.meshes[instance.mesh];
    Eigen::Matrix4d transform =
        Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(instance.transform.data());
    Eigen::Affine3d ours_from_mesh;
    ours_from_mesh.linear() = result.unit_m * turned * transform.topLeftCorner<3, 3>();
    ours_from_mesh.translation() = result.unit_m * turned * transform.topRightCorner<3, 1>();
    if (!transform.allFinite() || !std::isfinite(ours_from_mesh.linear().squaredNorm()))
      throw Error(file.string() + ": the transform of " + label(instance, mesh) + " is not finite");
    const auto [stretch, pose] = decomposed(ours_from_mesh);
    const ScaledMesh* size = scales[instance.mesh].find(stretch);
    if (!size) {
      take(stretched_bytes(mesh));
      if ((scaled_triangles += mesh.indices.size() / 3) > options.most_triangles)
        throw Error(file.string() + ": its meshes, at all the scales of its nodes, have more than " +
                    std::to_string(options.most_triangles) + " triangles; simplify it, or divide it");
      size = &scales[instance.mesh].add(mesh, stretch);
    }
    result.degenerate += size->degenerate;
    if (size->mesh->triangles.empty()) continue;
    ImportedPart part;
    part.mesh = size->mesh;
    part.world_from_part = pose;
    part.name = instance.name.empty() ? mesh.name : instance.name;
    if (mesh.material < model.materials.size()) {
      const RawMaterial& material = model.materials[mesh.material];
      part.material = material.name;
      const double luminance = 0.2126 * static_cast<double>(material.colour[0]) +
                               0.7152 * static_cast<double>(material.colour[1]) +
                               0.0722 * static_cast<double>(material.colour[2]);
      if (!std::isfinite(luminance))
        throw Error(file.string() + ": the colour of material '" + material.name + "' is not finite; export it again");
      part.albedo = std::clamp(luminance, 0.0, 1.0);
      part.texture = texture_of(material);
    }
    take(sizeof part + part.name.size() + part.material.size() + part.texture.native().size());
    for (const Eigen::Vector3d& vertex : part.mesh->vertices) {
      const Eigen::Vector3d v = pose * vertex;
      result.low = result.low.cwiseMin(v), result.high = result.high.cwiseMax(v);
    }
    result.triangles += part.mesh->triangles.size();
    result.parts.push_back(std::move(part));
  }
  for (const Scales& of_mesh : scales) result.meshes += of_mesh.size();
  if (result.parts.empty()) throw Error(file.string() + ": contains no triangle of nonzero area");
  check_extent(file, result);
  return result;
}

}  // namespace fringeslam::sim

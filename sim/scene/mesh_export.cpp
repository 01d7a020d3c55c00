// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh_export.h"

#include <assimp/material.h>
#include <assimp/scene.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <assimp/Exporter.hpp>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <cctype>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <set>
#include <tuple>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/png_file.h"
#include "core/types/error.h"
#include "sim/light/photometry.h"

namespace fringeslam::sim {

namespace fs = std::filesystem;

namespace {

// The material properties that the file formats can express.
struct Finish {
  double albedo = 0.5, roughness = 1, emission = 0, opacity = 1;
  bool metal = false;
  std::string texture;
  auto key() const { return std::tie(albedo, roughness, emission, opacity, metal, texture); }
  bool operator<(const Finish& other) const { return key() < other.key(); }
};

// An emission of 1 corresponds to the projector's illuminance at 1 m; stronger emission is clamped.
Finish finish_of(const Object& object, const RigModel& rig) {
  const Material& material = object.material;
  Finish finish;
  finish.albedo = material.albedo;
  finish.metal = material.metal;
  if (material.metal || material.reflectance > 0) finish.roughness = material.roughness;
  if (material.emission_lux > 0) finish.emission = std::min(1.0, material.emission_lux / projector_lux_at_1m(rig));
  if (material.pane) finish.albedo = 0.8, finish.roughness = 0, finish.opacity = 0.2;
  if (!object.mesh->texture_coordinates.empty()) finish.texture = material.texture;
  return finish;
}

std::string bytes_of(const fs::path& file) { return read_input(file, kMostImageFileBytes); }

float srgb_from_linear(double value) {
  return static_cast<float>(value <= 0.0031308 ? 12.92 * value : 1.055 * std::pow(value, 1 / 2.4) - 0.055);
}

// Returns the texture as a PNG or JPEG file, converting it in `folder` if necessary.
fs::path common_picture(const fs::path& texture, const fs::path& folder, size_t number) {
  const std::string extension = lower_extension(texture);
  if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") return texture;
  const fs::path file = folder / (".converted_" + std::to_string(number) + ".png");
  cv::Mat pixels = read_pixels(texture);
  if (pixels.channels() > 4)
    throw Error(texture.string() + ": has " + std::to_string(pixels.channels()) +
                " channels; textures of at most four can be exported");
  if (pixels.depth() == CV_32F) {
    const bool alpha = pixels.channels() % 2 == 0;  // grey and alpha, or colors and alpha
    const cv::Mat1f values = pixels.reshape(1, static_cast<int>(pixels.total()));  // a row per pixel
    cv::Mat1f colours = values.colRange(0, values.cols - (alpha ? 1 : 0));
    for (float& value : colours) value = srgb_from_linear(value);
    pixels.convertTo(pixels, CV_8U, 255);
  } else if (pixels.depth() == CV_16U) {
    pixels.convertTo(pixels, CV_8U, 1 / 257.0);
  }
  write_text(file, encode_png(pixels, {}));
  return file;
}

std::unique_ptr<aiTexture> embedded(const fs::path& file) {
  const std::string bytes = bytes_of(file);
  auto texture = std::make_unique<aiTexture>();
  texture->mWidth = static_cast<unsigned>(bytes.size());  // encoded image: length in bytes
  texture->mHeight = 0;
  texture->pcData = new aiTexel[bytes.size() / sizeof(aiTexel) + 1];
  std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(texture->pcData));
  std::snprintf(texture->achFormatHint, sizeof texture->achFormatHint, "%s",
                lower_extension(file) == ".png" ? "png" : "jpg");
  return texture;
}

aiVector3D vector(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

aiMatrix4x4 matrix(const Pose& pose) {
  aiMatrix4x4 m;
  for (unsigned row = 0; row < 3; ++row) {
    for (unsigned col = 0; col < 3; ++col) m[row][col] = static_cast<float>(pose.rotation(row, col));
    m[row][3] = static_cast<float>(pose.translation[row]);
  }
  return m;
}

std::unique_ptr<aiMesh> allocated(size_t vertices, size_t triangles, bool coordinates) {
  auto mesh = std::make_unique<aiMesh>();
  mesh->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  mesh->mNumVertices = static_cast<unsigned>(vertices);
  mesh->mVertices = new aiVector3D[vertices];
  mesh->mNumFaces = static_cast<unsigned>(triangles);
  mesh->mFaces = new aiFace[triangles];
  if (coordinates) {
    mesh->mTextureCoords[0] = new aiVector3D[vertices];
    mesh->mNumUVComponents[0] = 2;
  }
  return mesh;
}

void set_face(aiFace& face, size_t a, size_t b, size_t c) {
  face.mNumIndices = 3;
  face.mIndices = new unsigned[3]{static_cast<unsigned>(a), static_cast<unsigned>(b), static_cast<unsigned>(c)};
}

void set_coordinate(aiMesh& mesh, size_t i, const Eigen::Vector2f& uv) {
  mesh.mTextureCoords[0][i] = {uv.x(), uv.y(), 0};
}

// Converts a mesh in its object frame.
std::unique_ptr<aiMesh> as_it_is(const Mesh& mesh) {
  const bool textured = !mesh.texture_coordinates.empty();
  std::unique_ptr<aiMesh> result = allocated(mesh.vertices.size(), mesh.triangles.size(), textured);
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    result->mVertices[i] = vector(mesh.vertices[i]);
    if (textured) set_coordinate(*result, i, mesh.texture_coordinates[i]);
  }
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Eigen::Vector3i& t = mesh.triangles[i];
    set_face(result->mFaces[i], static_cast<size_t>(t[0]), static_cast<size_t>(t[1]), static_cast<size_t>(t[2]));
  }
  return result;
}

// Converts an object to the world frame with separate vertices and a face normal per triangle, because viewers would
// otherwise smooth sharp edges.
std::unique_ptr<aiMesh> faceted(const Object& object) {
  const Mesh& mesh = *object.mesh;
  const bool textured = !mesh.texture_coordinates.empty();
  std::unique_ptr<aiMesh> result = allocated(3 * mesh.triangles.size(), mesh.triangles.size(), textured);
  result->mNormals = new aiVector3D[result->mNumVertices];
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    Eigen::Vector3d corner[3];
    for (size_t k = 0; k < 3; ++k) {
      const auto vertex = static_cast<size_t>(mesh.triangles[i][static_cast<int>(k)]);
      corner[k] = object.world_from_object * mesh.vertices[vertex];
      result->mVertices[3 * i + k] = vector(corner[k]);
      if (textured) set_coordinate(*result, 3 * i + k, mesh.texture_coordinates[vertex]);
    }
    const Eigen::Vector3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
    for (size_t k = 0; k < 3; ++k) result->mNormals[3 * i + k] = vector(normal);
    set_face(result->mFaces[i], 3 * i, 3 * i + 1, 3 * i + 2);
  }
  return result;
}

// Merges all objects into one mesh in the world frame, with the albedo as vertex colour.
std::unique_ptr<aiMesh> merged(const Scene& scene) {
  size_t vertices = 0, triangles = 0;
  for (const Object& object : scene.objects) {
    vertices += object.mesh->vertices.size();
    triangles += object.mesh->triangles.size();
  }
  std::unique_ptr<aiMesh> result = allocated(vertices, triangles, false);
  result->mColors[0] = new aiColor4D[vertices];
  size_t vertex = 0, triangle = 0;
  for (const Object& object : scene.objects) {
    const size_t first = vertex;
    const float grey = srgb_from_linear(object.material.albedo);
    for (const Eigen::Vector3d& v : object.mesh->vertices) {
      result->mVertices[vertex] = vector(object.world_from_object * v);
      result->mColors[0][vertex++] = {grey, grey, grey, 1};
    }
    for (const Eigen::Vector3i& t : object.mesh->triangles) {
      set_face(result->mFaces[triangle++], first + static_cast<size_t>(t[0]), first + static_cast<size_t>(t[1]),
               first + static_cast<size_t>(t[2]));
    }
  }
  return result;
}

// Builds an assimp scene, which takes ownership of all parts.
class Builder {
 public:
  Builder(const Scene& scene, MeshFormat format, const fs::path& file) : scene_(scene), format_(format), file_(file) {}

  std::unique_ptr<aiScene> built() {
    result_->mRootNode = new aiNode(scene_.name);
    if (format_ == MeshFormat::ply) {
      finishes_[Finish{}] = 0;
      add_node(scene_.name, Pose{}, add_mesh(merged(scene_), Finish{}, scene_.name));
    } else {
      for (const Object& object : scene_.objects) add(object);
    }
    if (format_ == MeshFormat::gltf)
      result_->mRootNode->mTransformation = matrix({y_up_from_z_up(), Eigen::Vector3d::Zero()});
    add_materials();
    for (const auto& node : nodes_) node->mParent = result_->mRootNode;
    hand_over(nodes_, result_->mRootNode->mChildren, result_->mRootNode->mNumChildren);
    hand_over(meshes_, result_->mMeshes, result_->mNumMeshes);
    hand_over(materials_, result_->mMaterials, result_->mNumMaterials);
    hand_over(textures_, result_->mTextures, result_->mNumTextures);
    return std::move(result_);
  }

 private:
  static Eigen::Matrix3d y_up_from_z_up() {
    Eigen::Matrix3d rotation;
    rotation << 1, 0, 0, 0, 0, 1, 0, -1, 0;
    return rotation;
  }

  void add(const Object& object) {
    const Finish finish = finish_of(object, scene_.rig);
    if (format_ == MeshFormat::obj) {
      // OBJ names end at a space.
      std::string name = object.name;
      std::replace(name.begin(), name.end(), ' ', '_');
      add_node(name, Pose{}, add_mesh(faceted(object), finish, name));
      return;
    }
    const auto key = std::pair(object.mesh.get(), material_of(finish));
    if (!shared_.count(key)) shared_[key] = add_mesh(as_it_is(*object.mesh), finish, object.name);
    add_node(object.name, object.world_from_object, shared_[key]);
  }

  unsigned material_of(const Finish& finish) {
    return finishes_.try_emplace(finish, static_cast<unsigned>(finishes_.size())).first->second;
  }

  unsigned add_mesh(std::unique_ptr<aiMesh> mesh, const Finish& finish, const std::string& name) {
    mesh->mName = name;
    mesh->mMaterialIndex = material_of(finish);
    meshes_.push_back(std::move(mesh));
    return static_cast<unsigned>(meshes_.size() - 1);
  }

  void add_node(const std::string& name, const Pose& pose, unsigned mesh) {
    auto node = std::make_unique<aiNode>(name);
    node->mTransformation = matrix(pose);
    node->mNumMeshes = 1;
    node->mMeshes = new unsigned[1]{mesh};
    nodes_.push_back(std::move(node));
  }

  void add_materials() {
    materials_.resize(finishes_.size());
    for (const auto& [finish, index] : finishes_) materials_[index] = material(finish, index);
  }

  std::unique_ptr<aiMaterial> material(const Finish& finish, unsigned index) {
    auto result = std::make_unique<aiMaterial>();
    const aiString name("material_" + std::to_string(index + 1));
    const auto grey = static_cast<float>(finish.albedo), glow = static_cast<float>(finish.emission);
    const aiColor4D colour(grey, grey, grey, 1), emission(glow, glow, glow, 1);
    const float metal = finish.metal ? 1.0f : 0.0f, roughness = static_cast<float>(finish.roughness);
    const auto opacity = static_cast<float>(finish.opacity);
    const int two_sided = 1;
    result->AddProperty(&name, AI_MATKEY_NAME);
    result->AddProperty(&colour, 1, AI_MATKEY_COLOR_DIFFUSE);
    result->AddProperty(&colour, 1, AI_MATKEY_BASE_COLOR);
    result->AddProperty(&emission, 1, AI_MATKEY_COLOR_EMISSIVE);
    result->AddProperty(&metal, 1, AI_MATKEY_METALLIC_FACTOR);
    result->AddProperty(&roughness, 1, AI_MATKEY_ROUGHNESS_FACTOR);
    result->AddProperty(&two_sided, 1, AI_MATKEY_TWOSIDED);
    if (opacity < 1) result->AddProperty(&opacity, 1, AI_MATKEY_OPACITY);
    if (finish.texture.empty()) return result;
    const aiString texture(texture_name(finish.texture));
    result->AddProperty(&texture, AI_MATKEY_TEXTURE_DIFFUSE(0));
    result->AddProperty(&texture, AI_MATKEY_TEXTURE(aiTextureType_BASE_COLOR, 0));
    return result;
  }

  // Returns the texture's name in the file: a file beside an OBJ, the Nth embedded image of a glTF.
  std::string texture_name(const std::string& texture) {
    if (const auto known = texture_names_.find(texture); known != texture_names_.end()) return known->second;
    if (!fs::exists(texture)) throw Error(texture + ": the texture does not exist");
    const size_t number = texture_names_.size();
    const fs::path picture = common_picture(texture, file_.parent_path(), number);
    std::string name = "*" + std::to_string(number);
    if (format_ == MeshFormat::obj) {
      name = file_.stem().string() + "_texture_" + std::to_string(number + 1) + lower_extension(picture);
      std::replace(name.begin(), name.end(), ' ', '_');
      copy_input(picture, file_.parent_path() / name);
    } else {
      textures_.push_back(embedded(picture));
    }
    if (picture != fs::path(texture)) fs::remove(picture);
    return texture_names_[texture] = name;
  }

  template <class T>
  static void hand_over(std::vector<std::unique_ptr<T>>& items, T**& array, unsigned& count) {
    if (items.empty()) return;
    array = new T*[items.size()];
    for (std::unique_ptr<T>& item : items) array[count++] = item.release();
  }

  const Scene& scene_;
  MeshFormat format_;
  fs::path file_;
  std::unique_ptr<aiScene> result_ = std::make_unique<aiScene>();
  std::vector<std::unique_ptr<aiNode>> nodes_;
  std::vector<std::unique_ptr<aiMesh>> meshes_;
  std::vector<std::unique_ptr<aiMaterial>> materials_;
  std::vector<std::unique_ptr<aiTexture>> textures_;
  std::map<Finish, unsigned> finishes_;
  std::map<std::pair<const Mesh*, unsigned>, unsigned> shared_;
  std::map<std::string, std::string> texture_names_;
};

// Takes the files that assimp exports into memory, because its exporters of OBJ and PLY do not notice a full disk.
class FilesToWrite : public Assimp::IOSystem {
 public:
  bool Exists(const char* file) const override { return files_.contains(file); }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* file, const char*) override { return new Stream(files_[file] = ""); }
  void Close(Assimp::IOStream* stream) override { delete stream; }

  // Writes the files.
  void write() const {
    for (const auto& [file, bytes] : files_) write_text(file, bytes);
  }

 private:
  class Stream : public Assimp::IOStream {
   public:
    explicit Stream(std::string& bytes) : bytes_(bytes) {}
    size_t Read(void*, size_t, size_t) override { return 0; }
    size_t Write(const void* from, size_t size, size_t count) override {
      const size_t more = size * count;
      if (more == 0) return count;
      bytes_.resize(std::max(bytes_.size(), at_ + more));
      std::memcpy(bytes_.data() + at_, from, more);
      at_ += more;
      return count;
    }
    aiReturn Seek(size_t offset, aiOrigin origin) override {
      at_ = offset + (origin == aiOrigin_CUR ? at_ : origin == aiOrigin_END ? bytes_.size() : 0);
      return aiReturn_SUCCESS;
    }
    size_t Tell() const override { return at_; }
    size_t FileSize() const override { return bytes_.size(); }
    void Flush() override {}

   private:
    std::string& bytes_;
    size_t at_ = 0;
  };

  std::map<std::string, std::string> files_;  // by path
};

// Returns assimp's identifier of the format.
std::string writer_of(MeshFormat format, const fs::path& file) {
  if (format == MeshFormat::ply) return "ply";  // text: the binary writer declares byte colours but writes floats
  if (format == MeshFormat::obj) return "obj";
  return lower_extension(file) == ".glb" ? "glb2" : "gltf2";
}

// Returns what follows `begin` up to `end` wherever it occurs in the text.
std::set<std::string> texts_between(const std::string& text, const std::string& begin, char end) {
  std::set<std::string> found;
  for (size_t at = 0; (at = text.find(begin, at)) != std::string::npos;) {
    at += begin.size();
    found.insert(text.substr(at, text.find(end, at) - at));
  }
  return found;
}

// Returns the names of the companion files to which an earlier export refers; none if there is no export.
std::set<std::string> companions_of(const fs::path& file, MeshFormat format) {
  constexpr size_t kHead = 1 << 16;  // bytes of an OBJ file, which names its materials before the vertices
  try {
    if (format == MeshFormat::gltf) return texts_between(read_input(file, kMostDataBytes), "\"uri\": \"", '"');
    if (format != MeshFormat::obj) return {};
    std::set<std::string> names = texts_between("\n" + InputFile(file, kMostDataBytes).head(kHead), "\nmtllib ", '\n');
    const std::string materials = file.stem().string() + ".mtl";
    if (names.contains(materials))
      names.merge(texts_between("\n" + read_input(file.parent_path() / materials), "\nmap_Kd ", '\n'));
    return names;
  } catch (const Error&) {
    return {};
  }
}

}  // namespace

MeshFormat mesh_format_of(const fs::path& file) {
  const std::string extension = lower_extension(file);
  if (extension == ".gltf" || extension == ".glb") return MeshFormat::gltf;
  if (extension == ".ply") return MeshFormat::ply;
  if (extension == ".obj") return MeshFormat::obj;
  throw Error(file.string() + ": unsupported mesh format; use .glb, .gltf, .ply or .obj");
}

MeshExport export_mesh(const Scene& scene, const fs::path& file, const std::vector<fs::path>& inputs) {
  const MeshFormat format = mesh_format_of(file);
  StagedFile staged(file);
  Builder builder(scene, format, staged.path());
  const std::unique_ptr<aiScene> model = builder.built();
  Assimp::Exporter exporter;
  auto* files = new FilesToWrite;
  exporter.SetIOHandler(files);  // which then belongs to it
  if (exporter.Export(model.get(), writer_of(format, file), staged.path().string()) != aiReturn_SUCCESS)
    throw Error(file.string() + ": cannot be written: " + exporter.GetErrorString());
  files->write();
  const std::vector<std::string> companions = staged.companions();
  for (const std::string& name : companions) {
    const fs::path companion = staged.target().parent_path() / name;
    std::error_code differs;
    for (const fs::path& input : inputs) {
      if (fs::equivalent(companion, input, differs) && !differs)
        throw Error(companion.string() + ": is an input, which would be replaced; choose another --out");
    }
  }
  staged.commit(companions.empty() ? std::set<std::string>() : companions_of(staged.target(), format));
  MeshExport result{scene.objects.size(), 0, model->mNumMeshes};
  for (const Object& object : scene.objects) result.triangles += object.mesh->triangles.size();
  return result;
}

}  // namespace fringeslam::sim

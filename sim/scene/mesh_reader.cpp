// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh_reader.h"

#include <assimp/MemoryIOWrapper.h>
#include <assimp/commonMetaData.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cmath>
#include <cstring>
#include <memory>
#include <set>
#include <string_view>

#include "core/base/limited_child.h"
#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/types/error.h"
#include "sim/scene/uri.h"

namespace fringeslam::sim {

namespace {

RawMesh raw_mesh(const aiMesh& mesh) {
  RawMesh raw;
  raw.name = mesh.mName.C_Str();
  raw.material = mesh.mMaterialIndex;
  for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
    for (const float value : {mesh.mVertices[i].x, mesh.mVertices[i].y, mesh.mVertices[i].z})
      raw.positions.push_back(value);
    if (!mesh.HasTextureCoords(0)) continue;
    raw.coordinates.push_back(mesh.mTextureCoords[0][i].x);
    raw.coordinates.push_back(mesh.mTextureCoords[0][i].y);
  }
  for (unsigned i = 0; i < mesh.mNumFaces; ++i) {
    if (mesh.mFaces[i].mNumIndices != 3) continue;  // points and lines
    for (int k = 0; k < 3; ++k) raw.indices.push_back(mesh.mFaces[i].mIndices[k]);
  }
  return raw;
}

void add_instances(const aiNode& node, const aiMatrix4x4& parent, RawModel& model) {
  const aiMatrix4x4 here = parent * node.mTransformation;
  for (unsigned i = 0; i < node.mNumMeshes; ++i) {
    RawInstance instance{node.mName.C_Str(), node.mMeshes[i], {}};
    for (unsigned k = 0; k < 16; ++k) instance.transform[k] = static_cast<double>(here[k / 4][k % 4]);
    model.instances.push_back(std::move(instance));
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i) add_instances(*node.mChildren[i], here, model);
}

// Refers to an embedded texture by its number; archives (.zae) and FBX files refer to theirs by name.
std::string numbered(const aiScene& scene, const std::string& texture) {
  if (texture.empty() || texture[0] == '*') return texture;
  const int number = scene.GetEmbeddedTextureAndIndex(texture.c_str()).second;
  return number >= 0 ? "*" + std::to_string(number) : texture;
}

RawMaterial raw_material(const aiScene& scene, const aiMaterial& material) {
  RawMaterial raw;
  raw.name = material.GetName().C_Str();
  aiColor4D colour(0.5f, 0.5f, 0.5f, 1);
  if (material.Get(AI_MATKEY_BASE_COLOR, colour) != aiReturn_SUCCESS) material.Get(AI_MATKEY_COLOR_DIFFUSE, colour);
  raw.colour = {colour.r, colour.g, colour.b};
  aiString texture;
  for (const aiTextureType type : {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE}) {
    if (raw.texture.empty() && material.GetTexture(type, 0, &texture) == aiReturn_SUCCESS)
      raw.texture = numbered(scene, texture.C_Str());
  }
  return raw;
}

RawTexture raw_texture(const aiTexture& texture) {
  RawTexture raw;
  const auto* bytes = reinterpret_cast<const uint8_t*>(texture.pcData);
  if (texture.mHeight == 0) {  // encoded; mWidth is the length in bytes
    raw.format = texture.achFormatHint;
    raw.bytes.assign(bytes, bytes + texture.mWidth);
  } else {
    raw.width = texture.mWidth;
    raw.bytes.assign(bytes, bytes + sizeof(aiTexel) * texture.mWidth * texture.mHeight);
  }
  return raw;
}

// Name of the importer that read the file: its content counts, not its extension.
enum class SourceFormat { collada, gltf, fbx, other };

SourceFormat format_of(const aiScene& scene) {
  aiString name;
  if (!scene.mMetaData || !scene.mMetaData->Get(AI_METADATA_SOURCE_FORMAT, name)) return SourceFormat::other;
  const std::string_view text = name.C_Str();
  if (text.find("Collada") != std::string_view::npos) return SourceFormat::collada;
  if (text.find("glTF") != std::string_view::npos) return SourceFormat::gltf;
  if (text.find("FBX") != std::string_view::npos) return SourceFormat::fbx;
  return SourceFormat::other;
}

// Returns the file that a mesh names, which in glTF is a URI; `folder` is that of the mesh, by which assimp extends the name.
std::string named_file(const std::string& name, const std::string& folder) {
  std::error_code unknown;
  if (std::filesystem::exists(name, unknown) || !name.starts_with(folder)) return name;
  std::string decoded = folder + percent_decoded(name.substr(folder.size()));
  return std::filesystem::exists(decoded, unknown) ? decoded : name;
}

// True for a text file behind a byte order mark, which assimp does not expect. Binary files can begin with the same bytes.
bool has_byte_order_mark(std::string_view bytes, const std::string& extension) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (!bytes.starts_with(kMark)) return false;
  bytes.remove_prefix(kMark.size());
  if (extension == ".ply") return bytes.starts_with("ply");
  if (extension == ".stl") return bytes.starts_with("solid");
  return extension == ".obj" || extension == ".mtl" || extension == ".off";
}

// Adds the zeros that numbers such as .5 lack in the vertices of a Wavefront file: assimp does not count these as numbers.
std::string with_leading_zeros(const std::string& text) {
  std::string result;
  result.reserve(text.size());
  for (size_t begin = 0, end = 0; begin < text.size(); begin = end) {
    end = std::min(text.find('\n', begin), text.size() - 1) + 1;
    const size_t first = text.find_first_not_of(" \t", begin);
    const bool is_vertex = first < end && text[first] == 'v';
    for (size_t i = begin; i < end; ++i) {
      if (is_vertex && text[i] == '.' && i > begin && (text[i - 1] == ' ' || text[i - 1] == '\t')) result += '0';
      result += text[i];
    }
  }
  return result;
}

// Gives assimp the content of regular files and nothing else. Remembers these files, and a file that has to be refused.
class BoundedFiles : public Assimp::IOSystem {
 public:
  explicit BoundedFiles(const std::filesystem::path& mesh)
      : folder_(mesh.has_parent_path() ? (mesh.parent_path() / "").string() : "") {}
  bool Exists(const char* file) const override {
    std::error_code unknown;
    return std::filesystem::exists(named_file(file, folder_), unknown);
  }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* name, const char* mode) override {
    std::error_code unknown;
    const std::string file = named_file(name, folder_), extension = lower_extension(file);
    if (std::strpbrk(mode, "wa+") || !std::filesystem::exists(file, unknown)) return nullptr;
    try {
      std::string bytes = read_input(file, kMostMeshBytes);
      if (has_byte_order_mark(bytes, extension)) bytes.erase(0, 3);
      if (extension == ".obj") bytes = with_leading_zeros(bytes);
      auto copy = std::make_unique<uint8_t[]>(bytes.size());
      std::memcpy(copy.get(), bytes.data(), bytes.size());
      opened_.insert(file);
      return new Assimp::MemoryIOStream(copy.release(), bytes.size(), true);
    } catch (const Error& e) {
      refused_ = e.what();
      return nullptr;
    }
  }
  void Close(Assimp::IOStream* stream) override { delete stream; }
  const std::string& refused() const { return refused_; }
  const std::set<std::string>& opened() const { return opened_; }

 private:
  std::string folder_, refused_;
  std::set<std::string> opened_;
};

// Returns the unit in m, or 0 if unknown. FBX gives centimetres per unit; assimp converts COLLADA to metres; glTF is in
// metres.
double unit_of(const aiScene& scene, SourceFormat format) {
  if (format == SourceFormat::collada || format == SourceFormat::gltf) return 1;
  if (!scene.mMetaData) return 0;
  float single = 0;
  double whole = 0;
  if (scene.mMetaData->Get("UnitScaleFactor", single) && single > 0) return 0.01 * static_cast<double>(single);
  if (scene.mMetaData->Get("UnitScaleFactor", whole) && whole > 0) return 0.01 * whole;
  return 0;
}

// Returns 'm' and the packed model, 'e' and assimp's error message, or 'r' and the message about a refused file.
std::string answer(const std::filesystem::path& file) {
  Assimp::Importer importer;
  auto* files = new BoundedFiles(file);
  importer.SetIOHandler(files);  // which then belongs to it
  importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_USE_COLLADA_NAMES, true);
  const aiScene* scene = importer.ReadFile(file.string(), aiProcess_Triangulate | aiProcess_SortByPType);
  if (!files->refused().empty()) return "r" + files->refused();
  if (!scene || !scene->mRootNode) return std::string("e") + importer.GetErrorString();
  RawModel model;
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) model.meshes.push_back(raw_mesh(*scene->mMeshes[i]));
  for (unsigned i = 0; i < scene->mNumMaterials; ++i)
    model.materials.push_back(raw_material(*scene, *scene->mMaterials[i]));
  for (unsigned i = 0; i < scene->mNumTextures; ++i) model.textures.push_back(raw_texture(*scene->mTextures[i]));
  for (const std::string& opened : files->opened()) model.files.push_back({opened});
  add_instances(*scene->mRootNode, aiMatrix4x4(), model);
  const SourceFormat format = format_of(*scene);
  model.unit_m = unit_of(*scene, format);
  model.y_up = format != SourceFormat::other;
  return "m" + packed(model);
}

std::string answer_or_error(const std::filesystem::path& file) {
  try {
    return answer(file);
  } catch (const std::bad_alloc&) {
    return "ereading it exceeds the memory limit";
  } catch (const std::exception& e) {
    return std::string("e") + e.what();
  }
}

// Memory that reading the file can need: a multiple of its size and of that of the files beside it, to which it may refer.
// Small files that expand to gigabytes are refused long before `most_gib`.
double needed_gib(const std::filesystem::path& file, double most_gib) {
  constexpr double kLeast_gib = 0.5, kPerByte = 64;
  double bytes = 0;
  std::error_code failed;
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  for (std::filesystem::directory_iterator entry(folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    std::error_code unknown;
    if (entry->is_regular_file(unknown)) bytes += static_cast<double>(entry->file_size(unknown));
  }
  return std::min(most_gib, kLeast_gib + kPerByte * bytes / (1024.0 * 1024 * 1024));
}

std::string explained(const std::string& message, double memory_gib) {
  const auto says = [&](const char* part) { return message.find(part) != std::string::npos; };
  if (says("bad_alloc") || says("memory limit"))
    return "needs more than " + std::to_string(static_cast<int>(1024 * memory_gib)) +
           " MiB of memory; it is damaged, or has to be divided";
  if (says("No meshes remaining") || says("no meshes")) return "contains no triangles, only points or lines";
  return "is not a readable mesh: " + message;
}

}  // namespace

RawModel read_model(const std::filesystem::path& file, double time_limit_s, double most_memory_gib) {
  (void)InputFile(file, kMostMeshBytes);
  const double memory_limit_gib = needed_gib(file, most_memory_gib);
  const auto [end, bytes] =
      answer_of_child({time_limit_s, memory_limit_gib, ChildReads::files}, [&] { return answer_or_error(file); });
  if (end == ChildEnd::not_started) throw Error(file.string() + ": cannot start a process for the mesh reader");
  if (end == ChildEnd::too_slow)
    throw Error(file.string() + ": reading it takes longer than " + std::to_string(static_cast<int>(time_limit_s)) +
                " s; the file is broken or very large");
  if (end == ChildEnd::crashed)
    throw Error(file.string() + ": the mesh reader crashed; the file is probably broken, export it again");
  if (bytes[0] == 'e') {
    std::string message = bytes.substr(1);
    std::replace(message.begin(), message.end(), '\n', ' ');
    throw Error(file.string() + ": " + explained(message, memory_limit_gib));
  }
  if (bytes[0] == 'r') throw Error(file.string() + ": refers to " + bytes.substr(1));
  try {
    return unpacked(std::string_view(bytes).substr(1));
  } catch (const Error& e) {
    throw Error(file.string() + ": " + e.what() + "; the file is probably broken, export it again");
  }
}

}  // namespace fringeslam::sim

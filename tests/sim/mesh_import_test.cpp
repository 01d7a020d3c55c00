// SPDX-License-Identifier: Apache-2.0
// Mesh files of each format, intact and broken.
#include "sim/scene/mesh_import.h"

#include <gmock/gmock.h>
#include <zlib.h>

#include <Eigen/Geometry>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "core/io/files.h"
#include "core/types/error.h"
#include "sim/scene/raw_model.h"
#include "sim/scene/scene.h"
#include "sim/scene/uri.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::HasSubstr;

// A roof: two triangles over a base of 4 x 2 units, with the ridge at height 3 along the file's up axis (here z).
const char* const kObj = R"(mtllib roof.mtl
o roof
v 0 0 0
v 4 0 0
v 4 2 3
v 0 2 3
usemtl tiles
f 1 2 3
f 1 3 4
)";
const char* const kMtl = "newmtl tiles\nKd 0.8 0.4 0.2\n";
const char* const kPly = R"(ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
4 0 0
4 2 3
0 2 3
3 0 1 2
3 0 2 3
)";
const char* const kStl = R"(solid roof
facet normal 0 -1 1
outer loop
vertex 0 0 0
vertex 4 0 0
vertex 4 2 3
endloop
endfacet
facet normal 0 -1 1
outer loop
vertex 0 0 0
vertex 4 2 3
vertex 0 2 3
endloop
endfacet
endsolid roof
)";
// COLLADA in inches, z up.
const char* const kDae = R"(<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 4 0 0 4 2 3 0 2 3</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n" name="house"><scale>100 100 100</scale><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
)";
const char* const kFbx = R"(; FBX 7.4.0 project file
FBXHeaderExtension:  {
	FBXHeaderVersion: 1003
	FBXVersion: 7400
}
GlobalSettings:  {
	Version: 1000
	Properties70:  {
		P: "UpAxis", "int", "Integer", "",1
		P: "UpAxisSign", "int", "Integer", "",1
		P: "FrontAxis", "int", "Integer", "",2
		P: "FrontAxisSign", "int", "Integer", "",1
		P: "CoordAxis", "int", "Integer", "",0
		P: "CoordAxisSign", "int", "Integer", "",1
		P: "UnitScaleFactor", "double", "Number", "",2.54
	}
}
Objects:  {
	Geometry: 1000, "Geometry::roof", "Mesh" {
		Vertices: *12 {
			a: 0,0,0,4,0,0,4,3,-2,0,3,-2
		}
		PolygonVertexIndex: *6 {
			a: 0,1,-3,0,2,-4
		}
		GeometryVersion: 124
	}
	Model: 2000, "Model::roof", "Mesh" {
		Version: 232
	}
}
Connections:  {
	C: "OO",2000,0
	C: "OO",1000,2000
}
)";

std::string base64(const std::string& bytes) {
  static const char* const kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t three = 0;
    for (size_t k = 0; k < 3; ++k)
      three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (int k = 3; k >= 0; --k) text += kDigits[three >> (6 * k) & 63];
  }
  for (size_t k = 0; k < (3 - bytes.size() % 3) % 3; ++k) text[text.size() - 1 - k] = '=';
  return text;
}

// glTF: metres, y up; the node translates by (0, 10, 0). `largest` is the last index, `count` the declared number.
std::string gltf(uint16_t largest = 3, int count = 6) {
  std::string bytes;
  for (const float x : {0.f, 0.f, 0.f, 4.f, 0.f, 0.f, 4.f, 3.f, -2.f, 0.f, 3.f, -2.f})
    bytes.append(reinterpret_cast<const char*>(&x), 4);
  for (const uint16_t i : {uint16_t{0}, uint16_t{1}, uint16_t{2}, uint16_t{0}, uint16_t{2}, largest})
    bytes.append(reinterpret_cast<const char*>(&i), 2);
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"translation":[0,10,0]}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],)"
         R"("bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],)"
         R"("accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":4,"min":[0,0,-2],"max":[4,3,0]},)"
         R"({"bufferView":1,"componentType":5123,"type":"SCALAR","count":)" +
         std::to_string(count) + R"(}],"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,)" +
         base64(bytes) + "\"}]}";
}

std::string binary_stl(uint32_t says, int holds) {
  std::string bytes(80, ' ');
  bytes.append(reinterpret_cast<const char*>(&says), 4);
  for (int i = 0; i < holds; ++i) {
    for (const float x : {0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 4.f, 0.f, 0.f, 4.f, 2.f, 3.f})
      bytes.append(reinterpret_cast<const char*>(&x), 4);
    bytes.append(2, '\0');
  }
  return bytes;
}

class Import : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& name, const std::string& bytes) const {
    write_text(temp_ / name, bytes);
    return temp_ / name;
  }
  test::TempFolder temp_;
};

void expect_roof(const MeshImport& roof, double unit, const Eigen::Vector3d& low = Eigen::Vector3d::Zero()) {
  EXPECT_EQ(roof.triangles, 2u);
  EXPECT_EQ(roof.degenerate, 0u);
  EXPECT_NEAR((roof.low - low).norm(), 0, 1e-5 * unit);
  EXPECT_NEAR((roof.high - low - unit * Eigen::Vector3d(4, 2, 3)).norm(), 0, 1e-5 * unit);
  // Counter-clockwise seen from above.
  const Mesh& mesh = *roof.parts[0].mesh;
  const Eigen::Vector3i t = mesh.triangles[0];
  const Eigen::Vector3d a = mesh.vertices[static_cast<size_t>(t[0])];
  const Eigen::Vector3d normal =
      roof.parts[0].world_from_part.rotation *
      (mesh.vertices[static_cast<size_t>(t[1])] - a).cross(mesh.vertices[static_cast<size_t>(t[2])] - a);
  EXPECT_GT(normal.z(), 0);
}

TEST_F(Import, WavefrontWithItsMaterial) {
  file("roof.mtl", kMtl);
  const MeshImport roof = import_mesh(file("roof.obj", kObj));
  expect_roof(roof, 1);
  EXPECT_NEAR(roof.parts[0].albedo, 0.2126 * 0.8 + 0.7152 * 0.4 + 0.0722 * 0.2, 1e-6);
  EXPECT_THAT(roof.summary("roof.obj"), HasSubstr("unit 1 m, z up; 1 part, 2 triangles, 4 x 2 x 3 m"));
  EXPECT_THAT(roof.files, testing::ElementsAre(temp_ / "roof.mtl", temp_ / "roof.obj"));
}
TEST_F(Import, UnitAndUpAxisAsAsked) {
  MeshImportOptions options;
  options.unit_m = 0.001;
  expect_roof(import_mesh(file("roof.ply", kPly), options), 0.001);
  options.up = UpAxis::y;
  const MeshImport turned = import_mesh(file("roof.ply", kPly), options);
  EXPECT_NEAR((turned.high - turned.low - 0.001 * Eigen::Vector3d(4, 3, 2)).norm(), 0, 1e-9);
}
TEST_F(Import, Polygons) { expect_roof(import_mesh(file("roof.ply", kPly)), 1); }
TEST_F(Import, StereolithographyInText) { expect_roof(import_mesh(file("roof.stl", kStl)), 1); }
TEST_F(Import, StereolithographyInBinary) { EXPECT_EQ(import_mesh(file("roof.stl", binary_stl(3, 3))).triangles, 3u); }
TEST_F(Import, GltfMovesItsNodesAndIsTurnedUpright) {
  expect_roof(import_mesh(file("roof.gltf", gltf())), 1, {0, 0, 10});
}
// 400 x 200 x 300 inches are 10.2 x 5.1 x 7.6 m.
TEST_F(Import, ColladaInInchesIsHouseSized) {
  const MeshImport house = import_mesh(file("house.dae", kDae));
  expect_roof(house, 2.54);
  EXPECT_EQ(house.parts[0].name, "house");
}
TEST_F(Import, FbxInInches) { expect_roof(import_mesh(file("roof.fbx", kFbx)), 0.0254); }

// Nodes that use one mesh at the same scale share it; other scales and reflections need separate meshes.
TEST_F(Import, RepeatedMeshesAreShared) {
  std::string text = gltf();
  const std::string one = R"("scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"translation":[0,10,0]}])";
  text.replace(text.find(one), one.size(),
               R"("scenes":[{"nodes":[0,1,2,3]}],"nodes":[{"mesh":0,"translation":[0,10,0]},)"
               R"({"mesh":0,"rotation":[0,0.70710678,0,0.70710678]},{"mesh":0,"scale":[2,2,2]},)"
               R"({"mesh":0,"scale":[-1,1,1]}])");
  const MeshImport roofs = import_mesh(file("roofs.gltf", text));
  ASSERT_EQ(roofs.parts.size(), 4u);
  EXPECT_EQ(roofs.meshes, 3u);
  EXPECT_EQ(roofs.parts[0].mesh, roofs.parts[1].mesh);
  EXPECT_NE(roofs.parts[0].mesh, roofs.parts[3].mesh);
  EXPECT_THAT(roofs.summary("roofs.gltf"), HasSubstr("4 parts of 3 meshes, 8 triangles"));
  for (const ImportedPart& part : roofs.parts) {
    EXPECT_NEAR(part.world_from_part.rotation.determinant(), 1, 1e-12);
    const Mesh& mesh = *part.mesh;
    const Eigen::Vector3i t = mesh.triangles[0];
    const auto at = [&](int i) { return part.world_from_part * mesh.vertices[static_cast<size_t>(t[i])]; };
    EXPECT_GT((at(1) - at(0)).cross(at(2) - at(0)).z(), 0) << part.name;  // the roof from above
  }
}

TEST_F(Import, DegenerateTrianglesAreCountedAndDropped) {
  const std::string more = std::string(kObj) + "f 1 1 2\nv 8 0 0\nf 1 2 5\n";
  const MeshImport roof = import_mesh(file("roof.obj", more));
  EXPECT_EQ(roof.triangles, 2u);
  EXPECT_EQ(roof.degenerate, 2u);
}

// Editors of other systems write a byte order mark, and programs numbers without a leading zero.
TEST_F(Import, TextMayHaveAByteOrderMarkAndShortNumbers) {
  const std::string mark = "\xEF\xBB\xBF";
  for (const auto& [name, text] :
       {std::pair("roof.obj", kObj), std::pair("roof.ply", kPly), std::pair("roof.stl", kStl)})
    expect_roof(import_mesh(file(name, mark + text)), 1);
  const MeshImport small = import_mesh(file("small.obj", "v .0 0 0\nv .4 -.0 0\nv .4 .2 3\nf 1 2 3\n"));
  EXPECT_NEAR((small.high - Eigen::Vector3d(0.4, 0.2, 3)).norm(), 0, 1e-6);
}

TEST_F(Import, GltfNamesFilesByUris) {
  std::string text = gltf();
  const size_t begin = text.find("data:"), end = text.find('"', begin);
  std::string bytes;
  for (const float x : {0.f, 0.f, 0.f, 4.f, 0.f, 0.f, 4.f, 3.f, -2.f, 0.f, 3.f, -2.f})
    bytes.append(reinterpret_cast<const char*>(&x), 4);
  for (const int index : {0, 1, 2, 0, 2, 3}) bytes += {static_cast<char>(index), '\0'};
  (void)file("a roof.bin", bytes);
  for (const char* uri : {"a%20roof.bin", "a roof.bin"}) {
    const std::string named = text.substr(0, begin) + uri + text.substr(end);
    const MeshImport roof = import_mesh(file("roof.gltf", named));
    EXPECT_EQ(roof.triangles, 2u) << uri;
    EXPECT_TRUE(roof.files.contains(temp_ / "a roof.bin")) << uri;
  }
  EXPECT_EQ(percent_decoded("50%25 %2fa%zz%4"), "50% /a%zz%4");
}

// Every broken file is refused with a one-line error naming it, in bounded time and without crashing the program.
TEST_F(Import, BrokenFilesAreRefused) {
  const std::string obj = kObj, ply = kPly, stl = kStl, dae = kDae, fbx = kFbx, good_gltf = gltf();
  const auto without = [](std::string text, const std::string& part) {
    return text.replace(text.find(part), part.size(), "");
  };
  const auto with = [](std::string text, const std::string& from, const std::string& to) {
    return text.replace(text.find(from), from.size(), to);
  };
  const std::string junk = [] {
    std::string bytes;
    for (uint32_t i = 0; i < 5000; ++i) bytes += static_cast<char>(i * 2654435761u >> 21);
    return bytes;
  }();
  std::string nested;
  for (int i = 0; i < 20000; ++i) nested += "[";
  const std::vector<std::pair<std::string, std::string>> files = {
      {"empty.obj", ""},
      {"empty.ply", ""},
      {"empty.stl", ""},
      {"empty.glb", ""},
      {"junk.obj", junk},
      {"junk.ply", junk},
      {"junk.glb", junk},
      {"junk.fbx", junk},
      {"junk.dae", junk},
      {"points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"},
      {"flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"},
      {"index.obj", with(obj, "f 1 3 4", "f 1 3 99")},
      {"index.ply", with(ply, "3 0 2 3\n", "3 0 2 77\n")},
      {"nan.ply", with(ply, "4 2 3", "nan 2 3")},
      {"cut.ply", ply.substr(0, ply.find("4 2 3"))},
      {"lies.ply", with(ply, "element vertex 4", "element vertex 400000000")},
      {"lies.stl", binary_stl(4000000000u, 2)},
      {"cut.gltf", good_gltf.substr(0, good_gltf.size() / 2)},
      {"overrun.gltf", gltf(3, 6000000)},
      {"nested.gltf", nested},
      {"nothing.gltf", R"({"asset":{"version":"2.0"},"scenes":[{}],"scene":0})"},
      {"cut.dae", dae.substr(0, dae.find("<triangles"))},
      {"missing.dae", without(dae, "<library_visual_scenes>")},
      {"index.dae", with(dae, "0 1 2 0 2 3", "0 1 2 0 2 99")},
      {"cut.fbx", fbx.substr(0, fbx.find("PolygonVertexIndex"))},
      {"index.fbx", with(fbx, "0,1,-3,0,2,-4", "0,1,-3,0,2,-400")},
      {"text.xyz", "no format at all"},
  };
  MeshImportOptions options;
  options.time_limit_s = 20;
  options.memory_limit_gib = 1;
  for (const auto& [name, bytes] : files) {
    const std::filesystem::path path = file(name, bytes);
    const std::string message = error_of([&] { import_mesh(path, options); });
    EXPECT_THAT(message, testing::StartsWith(path.string() + ": ")) << name;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
  EXPECT_THAT(error_of([&] { import_mesh(temp_.path()); }), HasSubstr("is a folder"));
}

// assimp may drop triangles silently, but no out-of-range index reaches the result.
TEST(RawModelBytes, AreRefusedUnlessComplete) {
  RawModel model;
  model.meshes.push_back({"triangle", 1, {0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 1, 0, 0, 1}, {0, 1, 2}});
  model.instances.push_back({"node", 0, {1, 0, 0, 7, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}});
  model.materials.push_back({"paint", "*0", {0.5f, 0.4f, 0.3f}});
  model.textures.push_back({"png", 0, {1, 2, 3}});
  model.files.push_back({"triangle.mtl"});
  const std::string bytes = packed(model);
  const RawModel again = unpacked(bytes);
  EXPECT_EQ(packed(again), bytes);
  EXPECT_EQ(again.meshes[0].indices, model.meshes[0].indices);
  EXPECT_EQ(again.instances[0].transform[3], 7);
  EXPECT_EQ(again.materials[0].texture, "*0");
  EXPECT_EQ(again.textures[0].bytes.size(), 3u);
  EXPECT_EQ(again.files[0].path, "triangle.mtl");
  for (size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW(unpacked(std::string_view(bytes).substr(0, size)), Error) << size;
  EXPECT_THROW(unpacked(bytes + "x"), Error);
}

// A model with one mesh of so many vertices and triangles.
RawModel strip_model(size_t vertices, size_t triangles) {
  RawMesh strip{"strip", 0, {}, {}, {}};
  for (size_t i = 0; i < vertices; ++i) {
    for (const size_t coordinate : {i / 2, i % 2, size_t{0}}) strip.positions.push_back(static_cast<float>(coordinate));
  }
  for (uint32_t i = 0; i < triangles; ++i) {
    const auto first = i % static_cast<uint32_t>(vertices - 2);
    for (const uint32_t corner : {first, first + 1, first + 2}) strip.indices.push_back(corner);
  }
  RawModel model;
  model.meshes.push_back(std::move(strip));
  return model;
}

// A node that scales the first mesh along its axes.
RawInstance scaled_node(const Eigen::Vector3d& scale, const std::string& name = "node") {
  return {name, 0, {scale.x(), 0, 0, 0, 0, scale.y(), 0, 0, 0, 0, scale.z(), 0, 0, 0, 0, 1}};
}

TEST(ImportLimits, NodesMultiplyTheirMeshes) {
  constexpr size_t kMany = 20000;
  for (const auto& [vertices, triangles] : {std::pair(kMany, size_t{1}), std::pair(size_t{3}, kMany)}) {
    RawModel model = strip_model(vertices, triangles);
    model.instances.assign(kMostVerticesOfNodes / kMany + 1, scaled_node({1, 1, 1}));
    EXPECT_THAT(
        error_of([&] { import_model("strip.obj", model); }),
        testing::AllOf(testing::StartsWith("strip.obj: its nodes have "), HasSubstr("at most 200000000 of each")));
    model.instances.resize(2);
    EXPECT_EQ(import_model("strip.obj", model).triangles, 2 * triangles);
  }
}

TEST(ImportLimits, MeshesAtAllScalesFitInTheMemory) {
  MeshImportOptions options;
  options.memory_limit_gib = 10.0 / 1024;
  RawModel same = strip_model(1000, 1000), different = same, names = strip_model(3, 1);
  for (int i = 0; i < 400; ++i) {  // 14 MB of copies
    same.instances.push_back(scaled_node({2, 2, 2}));
    different.instances.push_back(scaled_node({1, 1, 1 + 0.01 * i}));
  }
  const MeshImport shared = import_model("strip.obj", same, options);
  EXPECT_EQ(shared.meshes, 1u);
  EXPECT_EQ(shared.parts.size(), 400u);
  names.instances.assign(12000, scaled_node({1, 1, 1}, std::string(1000, 'n')));
  for (const RawModel& model : {different, names})
    EXPECT_THAT(error_of([&] { import_model("strip.obj", model, options); }),
                HasSubstr("strip.obj: its nodes, and its meshes at all their scales, need more than 10 MiB of memory"));
}

TEST(ImportLimits, MeshesAtAllScalesHaveALimitOfTriangles) {
  MeshImportOptions options;
  options.most_triangles = 5000;
  RawModel model = strip_model(1000, 1000);
  model.instances.assign(50, scaled_node({2, 2, 2}));
  EXPECT_EQ(import_model("strip.obj", model, options).parts.size(), 50u) << "one mesh at one scale";
  for (int i = 0; i < 5; ++i) model.instances.push_back(scaled_node({1, 1, 1 + 0.01 * i}));
  EXPECT_THAT(error_of([&] { import_model("strip.obj", model, options); }), HasSubstr("more than 5000 triangles"));
}

TEST(ImportLimits, AnyNumberOfScalesIsSharedUpToRounding) {
  RawModel model = strip_model(4, 2);
  constexpr size_t kScales = 2000;
  for (const double rounding : {0.0, 1e-7, -1e-7}) {
    for (size_t i = 0; i < kScales; ++i) {
      const double scale = (1 + 1e-3 * static_cast<double>(i)) * (1 + rounding);
      model.instances.push_back(scaled_node({scale, scale, scale}));
    }
    for (int axis = 0; axis < 3; ++axis) {  // of the same norm
      Eigen::Vector3d scale = Eigen::Vector3d::Constant(5 * (1 + rounding));
      scale[axis] *= 2;
      model.instances.push_back(scaled_node(scale));
    }
  }
  const MeshImport strips = import_model("strip.obj", model);
  EXPECT_EQ(strips.parts.size(), 3 * (kScales + 3));
  EXPECT_EQ(strips.meshes, kScales + 3);
}

TEST_F(Import, IndicesAreWithinTheirMesh) {
  const MeshImport roof = import_mesh(file("index.gltf", gltf(60000)));
  EXPECT_LT(roof.triangles, 2u);
  for (const Eigen::Vector3i& t : roof.parts[0].mesh->triangles)
    EXPECT_LT(t.maxCoeff(), static_cast<int>(roof.parts[0].mesh->vertices.size()));
}

// An embedded image becomes the texture and is unpacked only once.
TEST_F(Import, PicturesInsideTheFileAreUnpacked) {
  setenv("FRINGESLAM_CACHE", (temp_ / "cache").c_str(), 1);
  const std::string image = [&] {
    write_png(temp_ / "grey.png", cv::Mat1b(2, 2, uchar{77}));
    std::ifstream in(temp_ / "grey.png", std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  }();
  std::string text = gltf();
  text.insert(text.find(R"("indices":1)"), R"("material":0,)");
  text.insert(text.find(R"("bufferViews")"),
              R"("materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],)"
              R"("images":[{"mimeType":"image/png","uri":"data:image/png;base64,)" +
                  base64(image) + "\"}],");
  const auto path = file("roof.gltf", text);
  const std::filesystem::path texture = import_mesh(path).parts[0].texture;
  ASSERT_TRUE(std::filesystem::exists(texture)) << texture;
  EXPECT_EQ(read_grey(texture).at<uchar>(1, 1), 77);
  EXPECT_EQ(import_mesh(path).parts[0].texture, texture);
  unsetenv("FRINGESLAM_CACHE");
}

// A ZIP archive of these files, stored without compression.
std::string zip_of(const std::vector<std::pair<std::string, std::string>>& files) {
  const auto number = [](uint64_t value, int bytes) {
    std::string text;
    for (int i = 0; i < bytes; ++i) text += static_cast<char>(value >> 8 * i & 255);
    return text;
  };
  std::string archive, directory;
  for (const auto& [name, bytes] : files) {
    const auto size = static_cast<uint32_t>(bytes.size());
    const auto crc =
        static_cast<uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(size)));
    // Version 2.0, no flags, stored, no date.
    const std::string entry = number(20, 2) + number(0, 8) + number(crc, 4) + number(size, 4) + number(size, 4) +
                              number(static_cast<uint32_t>(name.size()), 2) + number(0, 2);
    directory +=
        "PK\1\2" + number(20, 2) + entry + number(0, 10) + number(static_cast<uint32_t>(archive.size()), 4) + name;
    archive += "PK\3\4" + entry + name + bytes;
  }
  const auto count = static_cast<uint32_t>(files.size());
  return archive + directory + "PK\5\6" + number(0, 4) + number(count, 2) + number(count, 2) +
         number(static_cast<uint32_t>(directory.size()), 4) + number(static_cast<uint32_t>(archive.size()), 4) +
         number(0, 2);
}

// An archive refers to the images in it by their names.
TEST_F(Import, ColladaArchivesKeepTheirAxisAndTheirPictures) {
  setenv("FRINGESLAM_CACHE", (temp_ / "cache").c_str(), 1);
  const std::string collada = R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>textures/grey.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="r"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="c"><lambert><diffuse><texture texture="r" texcoord="UV"/></diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 3 0</float_array>
<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="6">0 0 1 0 0 1</float_array>
<technique_common><accessor source="#ta" count="3" stride="2"><param name="S" type="float"/><param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="k"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="TEXCOORD" source="#t" offset="1"/><p>0 0 1 1 2 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="k" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
  const MeshImport archive =
      import_mesh(file("board.zae", zip_of({{"manifest.xml", "<?xml version=\"1.0\"?><dae_root>./scene.dae</dae_root>"},
                                            {"scene.dae", collada},
                                            {"textures/grey.png", png_bytes(cv::Mat1b(2, 2, uchar{77}))}})));
  EXPECT_EQ(archive.up, UpAxis::y);
  ASSERT_TRUE(std::filesystem::exists(archive.parts[0].texture)) << archive.parts[0].texture;
  EXPECT_EQ(read_grey(archive.parts[0].texture).at<uchar>(1, 1), 77);
  unsetenv("FRINGESLAM_CACHE");
}

// Textures use the mesh's texture coordinates.
TEST_F(Import, TextureCoordinatesComeAlong) {
  cv::Mat1b image(64, 64, static_cast<uchar>(255));
  image.rowRange(0, 32) = 0;  // upper half, v > 1/2
  write_png(temp_ / "half.png", image);
  file("board.mtl", "newmtl m\nKd 1 1 1\nmap_Kd half.png\n");
  const MeshImport board =
      import_mesh(file("board.obj",
                       "mtllib board.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
                       "vt 0 1\nusemtl m\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"));
  ASSERT_EQ(board.parts[0].texture.filename(), "half.png");
  Object object;
  object.mesh = board.parts[0].mesh;
  object.world_from_object = pose_from({{0, 0, 1000}, {0, 0, 0}});
  object.material.texture = board.parts[0].texture.string();
  object.material.albedo = 1;
  const cv::Mat1f lux = lux_of(world_of({object}, coaxial_rig()), {constant_pattern(1)})[0];
  EXPECT_GT(lux(10, 32), 0.9 * kWhiteLux);  // y down: small rows are small y, small v
  EXPECT_LT(lux(38, 32), 0.05 * kWhiteLux);
}

}  // namespace
}  // namespace fringeslam::sim

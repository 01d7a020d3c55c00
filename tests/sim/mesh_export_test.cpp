// SPDX-License-Identifier: Apache-2.0
// Exported meshes survive re-import unchanged.
#include "sim/scene/mesh_export.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <fstream>
#include <limits>
#include <set>

#include "core/io/files.h"
#include "sim/scene/mesh_import.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

// Two bricks sharing one mesh, a rock and a floor, translated and rotated.
Scene small_world() {
  Object brick = grey_object(box_mesh({0.24, 0.115, 0.071}), pose_from({{1234, -567, 89}, {10, 20, 30}}), 0.3);
  Object rock = grey_object(rock_mesh({0.5, 0.4, 0.3}, 3, 0.3, 7), pose_from({{-700, 300, 150}, {0, 0, 50}}), 0.6);
  rock.material.metal = true;
  Object floor = grey_object(plane_mesh(6, 5), Pose{}, 0.45);
  Object other = brick;
  other.world_from_object = pose_from({{900, 100, 300}, {0, 90, 0}});
  Scene scene = world_of({brick, rock, floor, other}, coaxial_rig());
  scene.name = "small world";
  for (size_t i = 0; i < scene.objects.size(); ++i) scene.objects[i].name = "object " + std::to_string(i + 1);
  return scene;
}

struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
};

Box box_of(const Scene& scene) {
  Box box;
  for (const Object& object : scene.objects) {
    for (const Eigen::Vector3d& vertex : object.mesh->vertices) {
      const Eigen::Vector3d v = object.world_from_object * vertex;
      box.low = box.low.cwiseMin(v), box.high = box.high.cwiseMax(v);
    }
  }
  return box;
}

size_t triangles_of(const Scene& scene) {
  size_t triangles = 0;
  for (const Object& object : scene.objects) triangles += object.mesh->triangles.size();
  return triangles;
}

class Export : public testing::TestWithParam<std::string> {
 protected:
  test::TempFolder temp_;
};

TEST_P(Export, ComesBackAsItWas) {
  const Scene scene = small_world();
  const auto file = temp_ / ("world." + GetParam());
  const MeshExport written = export_mesh(scene, file);
  EXPECT_EQ(written.objects, 4u);
  EXPECT_EQ(written.triangles, triangles_of(scene));
  const MeshImport back = import_mesh(file);
  EXPECT_EQ(back.triangles, triangles_of(scene));
  EXPECT_EQ(back.degenerate, 0u);
  const Box box = box_of(scene);
  const double tolerance = 1e-6 * (box.high - box.low).maxCoeff();
  EXPECT_THAT(back.low, support::MatrixNear(box.low, tolerance));
  EXPECT_THAT(back.high, support::MatrixNear(box.high, tolerance));
}

// The signed volume of a closed surface depends on the orientation of its triangles.
TEST_P(Export, TrianglesKeepTheirOutside) {
  const Scene scene = world_of({grey_object(box_mesh({1, 2, 3}), pose_from({{500, 0, 0}, {40, 0, 0}}))}, coaxial_rig());
  export_mesh(scene, temp_ / ("box." + GetParam()));
  double volume = 0;
  for (const ImportedPart& part : import_mesh(temp_ / ("box." + GetParam())).parts) {
    for (const Eigen::Vector3i& t : part.mesh->triangles) {
      const auto at = [&](int i) { return part.mesh->vertices[static_cast<size_t>(t[i])]; };
      volume += at(0).dot(at(1).cross(at(2))) / 6;
    }
  }
  EXPECT_NEAR(volume, 6, 1e-5);
}

TEST_P(Export, LeavesNothingBesideItsFiles) {
  export_mesh(small_world(), temp_ / ("world." + GetParam()));
  std::set<std::string> expected = {"world." + GetParam()};
  if (GetParam() == "obj") expected.insert("world.mtl");
  if (GetParam() == "gltf") expected.insert("world.bin");
  EXPECT_EQ(test::listing(temp_.path()), expected);
}

TEST_P(Export, FailedWritesLeaveNothingBehind) {
  const auto nowhere = temp_ / ("none/world." + GetParam()), folder = temp_ / ("folder." + GetParam());
  std::filesystem::create_directory(folder);
  EXPECT_THAT(error_of([&] { export_mesh(small_world(), nowhere); }), StartsWith(nowhere.string() + ": cannot be"));
  EXPECT_THAT(error_of([&] { export_mesh(small_world(), folder); }), StartsWith(folder.string() + ": cannot be"));
  Scene scene = small_world();
  scene.objects[0].material.texture = (temp_ / "missing.png").string();
  Mesh textured = *scene.objects[0].mesh;
  textured.texture_coordinates.assign(textured.vertices.size(), {0.5f, 0.5f});
  scene.objects[0].mesh = std::make_shared<const Mesh>(textured);
  if (GetParam() != "ply") {
    EXPECT_THAT(error_of([&] { export_mesh(scene, temp_ / ("world." + GetParam())); }), HasSubstr("missing.png"));
  }
  EXPECT_THAT(test::listing(temp_.path()), ElementsAre("folder." + GetParam()));
}

INSTANTIATE_TEST_SUITE_P(Formats, Export, testing::Values("glb", "gltf", "ply", "obj"),
                         [](const auto& format) { return format.param; });

TEST(MeshExport, RepeatedMeshesStayShared) {
  const test::TempFolder temp;
  Scene scene = small_world();
  EXPECT_EQ(export_mesh(scene, temp / "world.glb").meshes, 3u);
  const MeshImport back = import_mesh(temp / "world.glb");
  EXPECT_EQ(back.meshes, 3u);
  ASSERT_EQ(back.parts.size(), 4u);
  EXPECT_EQ(back.parts[0].mesh, back.parts[3].mesh);
  // A different material needs a separate mesh, because glTF meshes include their material.
  scene.objects[3].material.albedo = 0.7;
  EXPECT_EQ(export_mesh(scene, temp / "world.glb").meshes, 4u);
}

TEST(MeshExport, GltfKeepsNamesPosesAndAlbedo) {
  const test::TempFolder temp;
  const Scene scene = small_world();
  for (const std::string name : {"world.glb", "world.gltf", "world.obj"}) {
    export_mesh(scene, temp / name);
    const MeshImport back = import_mesh(temp / name);
    ASSERT_EQ(back.parts.size(), scene.objects.size()) << name;
    for (size_t i = 0; i < back.parts.size(); ++i) {
      const bool flat = name == "world.obj";  // OBJ names end at a space
      EXPECT_EQ(back.parts[i].name, (flat ? "object_" : "object ") + std::to_string(i + 1));
      EXPECT_NEAR(back.parts[i].albedo, scene.objects[i].material.albedo, 1e-6) << name;
      if (!flat) {
        EXPECT_THAT(back.parts[i].world_from_part, support::PoseNear(scene.objects[i].world_from_object, 1e-6, 1e-6));
      }
    }
  }
}

// Textures are exported with their orientation preserved.
TEST(MeshExport, TexturesComeAlong) {
  const test::TempFolder temp;
  setenv("FRINGESLAM_CACHE", (temp / "cache").c_str(), 1);
  std::filesystem::create_directory(temp / "from");
  write_png(temp / "from/a b.png", cv::Mat1b(4, 4, uchar{77}));
  Mesh board = plane_mesh(1, 1);
  for (const Eigen::Vector3d& v : board.vertices)
    board.texture_coordinates.emplace_back(static_cast<float>(v.x()) + 0.5f, static_cast<float>(v.y()) + 0.5f);
  Object object = grey_object(board, Pose{}, 0.8);
  object.material.texture = (temp / "from/a b.png").string();
  const Scene scene = world_of({object}, coaxial_rig());
  for (const std::string name : {"a board.glb", "a board.gltf", "a board.obj"}) {
    for (int i = 0; i < 2; ++i) export_mesh(scene, temp / name);
    const MeshImport back = import_mesh(temp / name);
    ASSERT_EQ(back.parts.size(), 1u) << name;
    ASSERT_TRUE(std::filesystem::exists(back.parts[0].texture)) << name << " " << back.parts[0].texture;
    EXPECT_EQ(read_grey(back.parts[0].texture).at<uchar>(1, 1), 77) << name;
    const Mesh& mesh = *back.parts[0].mesh;
    ASSERT_EQ(mesh.texture_coordinates.size(), mesh.vertices.size()) << name;
    for (size_t i = 0; i < mesh.vertices.size(); ++i) {
      const Eigen::Vector3d v = back.parts[0].world_from_part * mesh.vertices[i];
      EXPECT_NEAR(mesh.texture_coordinates[i].x(), v.x() + 0.5, 1e-6) << name;
      EXPECT_NEAR(mesh.texture_coordinates[i].y(), v.y() + 0.5, 1e-6) << name;
    }
  }
  unsetenv("FRINGESLAM_CACHE");
}

TEST(MeshExport, CompanionsOfOtherFilesAreNotReplaced) {
  const test::TempFolder temp;
  const auto refused = [&](const std::string& name, const std::vector<std::filesystem::path>& inputs) {
    return error_of([&] { export_mesh(small_world(), temp / name, inputs); });
  };
  for (const auto& [name, companion] : {std::pair("world.obj", "world.mtl"), std::pair("world.gltf", "world.bin")}) {
    const std::string path = (temp / companion).string();
    test::write_bytes(path, "precious");
    EXPECT_THAT(refused(name, {}), StartsWith(path + ": exists and was not written with " + name));
    test::write_bytes(temp / name, "mtllib other world.mtl\n{\"uri\": \"other world.bin\"}");
    EXPECT_THAT(refused(name, {}), StartsWith(path + ": exists and was not written with " + name));
    EXPECT_EQ(test::read_bytes(path), "precious");
    std::filesystem::remove(path);
    for (int i = 0; i < 2; ++i) EXPECT_NO_THROW(export_mesh(small_world(), temp / name)) << name;
    EXPECT_THAT(refused(name, {path}), StartsWith(path + ": is an input"));
  }
}

TEST(MeshExport, OtherNamesAreRefused) {
  EXPECT_THAT(error_of([] { export_mesh(small_world(), "world.stl"); }),
              HasSubstr("world.stl: unsupported mesh format; use .glb"));
  EXPECT_THAT(error_of([] { mesh_format_of("world"); }), HasSubstr("world: unsupported mesh format"));
  EXPECT_EQ(mesh_format_of("a/b.GLB"), MeshFormat::gltf);
}

}  // namespace
}  // namespace fringeslam::sim

// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_vdb.h"

#include <gmock/gmock.h>
#include <openvdb/openvdb.h>

#include <Eigen/Geometry>
#include <bit>
#include <cmath>

#include "core/io/files.h"
#include "core/map/surface.h"
#include "tests/support/scene.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

// Reads the grid as other programs do: from a file, by its name.
openvdb::FloatGrid::Ptr grid_of(const std::string& vdb) {
  const test::TempFolder temp;
  const std::filesystem::path path = temp / "surface.vdb";
  write_text(path, vdb);
  openvdb::initialize();
  openvdb::io::File file(path.string());
  constexpr bool kDelayedLoad = false;
  file.open(kDelayedLoad);
  EXPECT_EQ(file.getGrids()->size(), 1U);
  return openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("surface"));
}

int64_t voxel(int16_t distance_steps, float weight) {
  return static_cast<int64_t>(static_cast<uint64_t>(std::bit_cast<uint32_t>(weight)) << 32 |
                              static_cast<uint16_t>(distance_steps));
}

TEST(SurfaceVdb, HoldsTheObservedVoxelsAsALevelSet) {
  constexpr VoxelScale kScale{0.5, 32767};  // a distance step is 1 m
  std::vector<int64_t> first(kBrickVoxels), second(kBrickVoxels), unseen(kBrickVoxels);
  first[0] = voxel(7, 4);
  first[(2 * kBrickEdge + 3) * kBrickEdge + 5] = voxel(-32767, 5);
  first[1] = voxel(1, 3.9F);
  second[kBrickVoxels - 1] = voxel(-3, 4);
  const std::vector<Brick> bricks = {
      {{-1, 0, 2}, first.data()}, {{0, 0, 0}, unseen.data()}, {{3, -4, 5}, second.data()}};
  const auto grid = grid_of(to_vdb(bricks, kScale, 4));
  EXPECT_EQ(grid->getGridClass(), openvdb::GRID_LEVEL_SET);
  EXPECT_EQ(grid->getCreator(), "FringeSLAM");
  EXPECT_EQ(grid->background(), 32767);
  EXPECT_EQ(grid->indexToWorld(openvdb::Coord(2, -4, 6)), openvdb::Vec3d(1, -2, 3));
  EXPECT_TRUE(grid->transform().isLinear());
  EXPECT_EQ(grid->activeVoxelCount(), 3U);
  EXPECT_EQ(grid->tree().leafCount(), 2U);
  const auto accessor = grid->getConstAccessor();
  const auto value = [&](int x, int y, int z) {
    EXPECT_TRUE(accessor.isValueOn({x, y, z}));
    return accessor.getValue({x, y, z});
  };
  EXPECT_EQ(value(-8, 0, 16), 7);
  EXPECT_EQ(value(-6, 3, 21), -32767);
  EXPECT_EQ(value(31, -25, 47), -3);
  for (const openvdb::Coord& unobserved : {openvdb::Coord(-8, 0, 17), openvdb::Coord(0, 0, 0)}) {
    EXPECT_FALSE(accessor.isValueOn(unobserved));
    EXPECT_EQ(accessor.getValue(unobserved), 32767);
  }
}

TEST(SurfaceVdb, OfNoVoxelsIsAnEmptyGrid) {
  EXPECT_TRUE(grid_of(to_vdb({}, {0.5, 1.5}, 1))->empty());
  // A voxel without weight is unobserved, however small the limit.
  const std::vector<int64_t> unseen(kBrickVoxels);
  EXPECT_TRUE(grid_of(to_vdb({{{0, 0, 0}, unseen.data()}}, {0.5, 1.5}, 0))->empty());
}

TEST(SurfaceVdb, HasItsZeroOnTheSurfaceAndIsPositiveInFront) {
  const RigModel rig = support::small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, -1).normalized();
  SurfaceModel model(rig, {});
  for (int i = 0; i < 3; ++i) {
    const Pose pose = pose_from({{7.0 * i, -5.0 * i, 3.0 * i}, {3.0 * i, 2.0 * i, 10.0 * i}});
    model.add(support::observe(support::plane(normal, -1), rig, pose, 1e-5), pose);
  }
  const auto grid = grid_of(model.to_vdb());
  EXPECT_EQ(grid->activeVoxelCount(), model.voxels());
  EXPECT_EQ(grid->voxelSize(), openvdb::Vec3d(model.voxel_m()));
  EXPECT_EQ(grid->background(), static_cast<float>(SurfaceOptions{}.truncation_voxels * model.voxel_m()));
  const auto accessor = grid->getConstAccessor();
  const auto height = [&](const openvdb::Vec3d& world) {
    return normal.dot(Eigen::Vector3d(world.x(), world.y(), world.z())) + 1;
  };
  size_t crossings = 0;
  for (auto on = grid->cbeginValueOn(); on; ++on) {
    const openvdb::Coord here = on.getCoord(), behind = here.offsetBy(0, 0, 1);
    // As in Surface.ObliquePlaneIsReproduced.
    ASSERT_NEAR(*on, height(grid->indexToWorld(here)), 8e-7);
    if (!accessor.isValueOn(behind) || !(*on >= 0 && accessor.getValue(behind) < 0)) continue;
    ++crossings;
    const double share = static_cast<double>(*on) / static_cast<double>(*on - accessor.getValue(behind));
    ASSERT_NEAR(height(grid->indexToWorld(here.asVec3d() + openvdb::Vec3d(0, 0, share))), 0, 8e-7);
  }
  EXPECT_GT(crossings, 10000U);
}

TEST(SurfaceVdb, LeavesOutWhatTheMeshLeavesOut) {
  const RigModel rig = support::small_rig(false);
  SurfaceModel model(rig, {.max_sigma_m = 1e-4});
  model.add(support::observe(support::plane({0, 0, -1}, -1), rig, {}, 2e-4), {});
  ASSERT_GT(model.voxels(), 0U);
  EXPECT_TRUE(grid_of(model.to_vdb())->empty());
}

TEST(SurfaceVdb, EqualSurfacesGiveEqualBytes) {
  const RigModel rig = support::small_rig(false);
  const auto vdb = [&](double depth) {
    SurfaceModel model(rig, {});
    model.add(support::observe(support::plane({0, 0, -1}, -depth), rig, {}, 1e-4), {});
    return model.to_vdb();
  };
  const std::string one = vdb(1);
  EXPECT_EQ(one, vdb(1));
  EXPECT_NE(one, vdb(1.001));
}

TEST(SurfaceVdb, IsIdentifiedByItsContent) {
  const test::TempFolder temp;
  const auto identifier = [&](int16_t distance_steps) {
    std::vector<int64_t> voxels(kBrickVoxels);
    voxels[0] = voxel(distance_steps, 1);
    write_text(temp / "surface.vdb", to_vdb({{{0, 0, 0}, voxels.data()}}, {0.5, 1.5}, 1));
    openvdb::io::File file((temp / "surface.vdb").string());
    file.open();
    return file.getUniqueTag();
  };
  EXPECT_EQ(identifier(1), identifier(1));
  EXPECT_NE(identifier(1), identifier(2));
}

}  // namespace
}  // namespace fringeslam

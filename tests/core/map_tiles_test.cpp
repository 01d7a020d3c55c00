// SPDX-License-Identifier: Apache-2.0
// Cloud and surface of a map that is divided into tiles equal those of the whole map.
#include "core/map/map_tiles.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <set>

#include "core/io/glb.h"
#include "core/io/ply_writer.h"
#include "core/map/frame_memory.h"
#include "core/map/map_cloud.h"
#include "core/map/surface.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;

// Forty views along 16 m of a bumpy plain, about the origin.
KeyframeMap long_map(int views = 40) {
  const RigModel rig = support::small_rig(true);
  const support::Surface plain = support::bumps(1, 0.02, 0.3);
  KeyframeMap map(rig, {});
  for (int i = 0; i < views; ++i) {
    const Pose pose = pose_from({{400.0 * i - 8000, 30.0 * i - 500, 0}, {0, 0, 2.0 * i}});
    map.add_keyframe(support::observe(plain, rig, pose, 1e-4), {}, pose);
  }
  return map;
}

using Triangles = std::vector<std::array<uint32_t, 3>>;

// Number of edges with a triangle on one side only.
size_t open_edges(const Triangles& triangles) {
  std::map<std::pair<uint32_t, uint32_t>, int> sides;
  for (const auto& t : triangles) {
    for (size_t i = 0; i < 3; ++i) ++sides[std::minmax(t[i], t[(i + 1) % 3])];
  }
  return static_cast<size_t>(
      std::count_if(sides.begin(), sides.end(), [](const auto& edge) { return edge.second == 1; }));
}

TEST(MapTiles, HoldTheFramesThatReachIntoThem) {
  const KeyframeMap map = long_map();
  const double unit_m = 0.02, margin_m = 0.05;
  const MapTiles tiling = tiles_of(map, 100, unit_m, margin_m);
  const std::vector<MapTile>& tiles = tiling.tiles;
  ASSERT_GT(tiles.size(), 5u);
  EXPECT_TRUE(
      std::is_sorted(tiles.begin(), tiles.end(), [](const MapTile& a, const MapTile& b) { return a.index < b.index; }));
  auto tile = tiles.begin();
  for (size_t f = 0; f < map.frames().size(); ++f) {
    const Frame frame = restored(map.frames()[f].frame, map.rays());
    const Pose pose = map.world_from_camera(map.frames()[f]);
    for (const cv::Vec3f& p : frame.points_m) {
      if (p[2] != p[2]) continue;
      const Eigen::Vector3d world = pose * vector_of(p);
      for (const double margin : {-margin_m, 0.0, margin_m}) {
        GridIndex unit;
        for (size_t i = 0; i < 3; ++i)
          unit[i] = static_cast<int32_t>(std::floor((world[static_cast<int>(i)] + margin) / unit_m));
        const auto holds = [&](const MapTile& t) { return tiling.range(t).contains(unit); };
        // Neighboring points are usually in the same tile.
        if (!holds(*tile)) tile = std::find_if(tiles.begin(), tiles.end(), holds);
        ASSERT_NE(tile, tiles.end());
        ASSERT_TRUE(std::binary_search(tile->frames.begin(), tile->frames.end(), f));
      }
    }
  }
}

TEST(MapTiles, BoxesOfAFrameHoldItsPointsAndNothingMore) {
  const KeyframeMap map = long_map(1);
  const StoredFrame& stored = map.frames()[0].frame;
  const Pose pose = pose_from({{-3e5, 2e5, 100}, {20, -10, 50}});
  const Frame frame = restored(stored, map.rays());
  const std::vector<WorldBox> boxes = boxes_of(stored, map.rays(), pose);
  ASSERT_GT(boxes.size(), 1u);
  std::vector<std::array<double, 6>> gaps_m(boxes.size(), {1, 1, 1, 1, 1, 1});
  size_t points = 0;
  for (const cv::Vec3f& p : frame.points_m) {
    if (p[2] != p[2]) continue;
    ++points;
    const Eigen::Vector3d world = pose * vector_of(p);
    size_t in = 0;
    for (size_t i = 0; i < boxes.size(); ++i) {
      const Eigen::Array3d above = world - boxes[i].low_m, below = boxes[i].high_m - world;
      if (!(above >= 0).all() || !(below >= 0).all()) continue;
      ++in;
      for (int k = 0; k < 3; ++k) {
        gaps_m[i][static_cast<size_t>(k)] = std::min(gaps_m[i][static_cast<size_t>(k)], above[k]);
        gaps_m[i][static_cast<size_t>(k) + 3] = std::min(gaps_m[i][static_cast<size_t>(k) + 3], below[k]);
      }
    }
    ASSERT_GE(in, 1u);
  }
  ASSERT_GT(points, 1000u);
  for (const auto& gaps : gaps_m) {
    for (const double gap_m : gaps) EXPECT_LT(gap_m, 1e-5);
  }
}

TEST(MapTiles, AFlatMapHasOneLayer) {
  const KeyframeMap map = long_map();
  const MapTiles tiling = tiles_of(map, 100, 0.02, 0);
  for (const MapTile& tile : tiling.tiles) EXPECT_EQ(tile.index[2], 0);
}

TEST(MapTiles, AUnitIsInOneTileAndTheLastOneIsKnown) {
  const MapTiles tiling = tiles_of(long_map(), 100, 0.02, 0);
  for (const MapTile& tile : tiling.tiles) {
    const auto [first, last] = tiling.range(tile);
    EXPECT_EQ(last[0] - first[0], 99);
    EXPECT_FALSE(tiling.is_last(first));
    EXPECT_TRUE(tiling.is_last(last));
    EXPECT_TRUE(tiling.is_last({first[0] - 1, first[1], first[2]}));
    for (const MapTile& other : tiling.tiles) EXPECT_EQ(tiling.range(other).contains(last), &other == &tile);
  }
}

TEST(MapTiles, FewFramesAreOneTile) {
  EXPECT_EQ(tile_edge(long_map(3), 0.01), 0);
  EXPECT_EQ(tiles_of(long_map(3), 0, 1, 0).tiles.size(), 1u);
  EXPECT_TRUE(tiles_of(KeyframeMap(support::small_rig(false), {}), 0, 1, 0).tiles.empty());
}

TEST(MapTiles, FramesFarFromTheOriginAreRefused) {
  const RigModel rig = support::small_rig(false);
  KeyframeMap map(rig, {});
  map.add_keyframe(support::observe(support::plane({0, 0, 1}, 1), rig, {}, 1e-4), {}, {});
  map.add_keyframe(map.keyframe_image(0), {}, {Eigen::Matrix3d::Identity(), {1e20, 0, 0}});
  EXPECT_THAT(error_of([&] { tiles_of(map, 1, 1, 0); }), HasSubstr("too far from the origin"));
}

TEST(MapTiles, GiveTheCloudOfTheWholeMap) {
  const KeyframeMap map = long_map();
  int parts = 0;
  std::vector<CloudPoint> tiled;
  for_each_cloud_part(
      map, {}, [&](const std::vector<CloudPoint>& part) { tiled.insert(tiled.end(), part.begin(), part.end()); },
      [&](size_t done, size_t) { parts = static_cast<int>(done); });
  EXPECT_GT(parts, 1);
  CloudMap whole(cell_m_of(map.rig(), {}));
  for (const MapFrame& frame : map.frames()) whole.add(restored(frame.frame, map.rays()), map.world_from_camera(frame));
  const auto less = [](const CloudPoint& a, const CloudPoint& b) {
    return std::lexicographical_compare(a.position_m.begin(), a.position_m.end(), b.position_m.begin(),
                                        b.position_m.end());
  };
  std::vector<CloudPoint> points = whole.points();
  std::sort(points.begin(), points.end(), less);
  std::sort(tiled.begin(), tiled.end(), less);
  ASSERT_EQ(tiled.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(tiled[i].position_m, points[i].position_m);
    ASSERT_EQ(tiled[i].sigma_m, points[i].sigma_m);
    ASSERT_EQ(tiled[i].grey, points[i].grey);
  }
}

TEST(MapTiles, GiveTheSurfaceOfTheWholeMapWithoutSeams) {
  const KeyframeMap map = long_map();
  SurfaceMesh tiled;
  size_t parts = 0;
  for_each_surface_part(
      map, {},
      [&](const SurfaceMesh& part) {
        tiled.vertices.insert(tiled.vertices.end(), part.vertices.begin(), part.vertices.end());
        tiled.triangles.insert(tiled.triangles.end(), part.triangles.begin(), part.triangles.end());
      },
      [&](size_t done, size_t) { parts = done; });
  EXPECT_GT(parts, 1u);
  const SurfaceMesh whole = surface_of(map, {}).mesh();
  ASSERT_GT(whole.triangles.size(), 100'000u);
  for (const auto& triangle : tiled.triangles) {
    for (const uint32_t corner : triangle) ASSERT_LT(corner, tiled.vertices.size());
  }
  // Frames are grouped differently, which affects rounding.
  const auto near = [](size_t a, size_t b) {
    return std::abs(static_cast<double>(a) - static_cast<double>(b)) <= 1e-4 * static_cast<double>(b) + 2;
  };
  EXPECT_TRUE(near(tiled.vertices.size(), whole.vertices.size()))
      << tiled.vertices.size() << ' ' << whole.vertices.size();
  EXPECT_TRUE(near(tiled.triangles.size(), whole.triangles.size()));
  const size_t open = open_edges(tiled.triangles), open_of_whole = open_edges(whole.triangles);
  EXPECT_NEAR(static_cast<double>(open), static_cast<double>(open_of_whole),
              0.002 * static_cast<double>(open_of_whole));
  // No vertex is there twice.
  std::set<std::array<float, 3>> positions;
  for (const CloudPoint& v : tiled.vertices) positions.insert({v.position_m.x(), v.position_m.y(), v.position_m.z()});
  EXPECT_GE(positions.size() + 2, tiled.vertices.size());
}

// The images outlive the map, and pages that were released come back with their content.
TEST(FrameMemory, KeepsImagesThatWereReleased) {
  const Frame frame = support::observe(support::corner({0, 0, 1.1}), support::small_rig(false), {}, 1e-4);
  const StoredFrame before = stored(frame);
  std::vector<StoredFrame> moved;
  {
    FrameMemory memory;
    const size_t enough = (size_t{300} << 20) / bytes_of(before);
    for (size_t i = 0; i < enough; ++i) moved.push_back(memory.moved(before));
    EXPECT_GE(memory.memory().allocated_bytes(), size_t{299} << 20);
  }
  for (const StoredFrame& after : moved) {
    ASSERT_EQ(cv::norm(after.texture, before.texture), 0);
    ASSERT_TRUE(std::equal(after.normals.begin(), after.normals.end(), before.normals.begin()));
    ASSERT_EQ(std::memcmp(after.depth_m.data, before.depth_m.data, before.depth_m.total() * sizeof(float)), 0);
  }
  moved.front().texture.create(3, 3);
  EXPECT_EQ(moved.front().texture.total(), 9u);
}

TEST(FileMemory, UsesOrdinaryMemoryWithoutAFolder) {
  FileMemory memory("/nonexistent");
  std::byte* const data = memory.allocate(100);
  EXPECT_FALSE(memory.on_disk());
  EXPECT_EQ(reinterpret_cast<uintptr_t>(data) % 64, 0u);
  for (size_t i = 0; i < 100; ++i) EXPECT_EQ(data[i], std::byte{0});
}

TEST(FileMemory, HoldsMoreThanASegment) {
  FileMemory memory;
  std::byte* const large = memory.allocate(size_t{100} << 20);
  large[(size_t{100} << 20) - 1] = std::byte{7};
  std::byte* const next = memory.allocate(1);
  EXPECT_EQ(*next, std::byte{0});
  EXPECT_EQ(large[(size_t{100} << 20) - 1], std::byte{7});
}

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(PlyWriter, PartsMakeTheFileOfTheWhole) {
  const test::TempFolder folder;
  const RigModel rig = support::small_rig(false);
  KeyframeMap map(rig, {});
  map.add_keyframe(support::observe(support::corner({0, 0, 1.1}), rig, {}, 1e-4), {}, {});
  const SurfaceMesh mesh = surface_of(map, {}).mesh();
  for (const size_t parts : {1u, 3u}) {
    PlyWriter file(folder / "mesh.ply", {"world", 0, true, true, 0});
    for (size_t i = 0; i < parts; ++i) {
      const auto part = [&](const auto& list) {
        return std::decay_t<decltype(list)>(list.begin() + static_cast<std::ptrdiff_t>(i * list.size() / parts),
                                            list.begin() + static_cast<std::ptrdiff_t>((i + 1) * list.size() / parts));
      };
      file.add(part(mesh.triangles));
      file.add(part(mesh.vertices));
    }
    file.finish();
    const std::string ply = to_ply(mesh, "world"), written = bytes_of(folder / "mesh.ply");
    const std::string end = "end_header\n";
    EXPECT_EQ(written.substr(written.find(end)), ply.substr(ply.find(end)));
    const PlyMap read = read_ply(folder / "mesh.ply");
    EXPECT_EQ(read.vertices.size(), mesh.vertices.size());
    EXPECT_EQ(read.triangles.size(), mesh.triangles.size());
    ply_to_glb(folder / "mesh.ply", folder / "mesh.glb");
    EXPECT_EQ(bytes_of(folder / "mesh.glb"), to_glb(mesh));
    EXPECT_FALSE(std::filesystem::exists(folder / "mesh.ply.faces"));
  }
  EXPECT_THAT(error_of([&] {
                PlyWriter(folder / "none" / "mesh.ply", {"world", 0, true, true, 0});
              }),
              HasSubstr("mesh.ply: cannot be written: No such file or directory"));
}

TEST(PlyWriter, MeshesBeyondTheLimitOfGlbAreNoticed) {
  EXPECT_TRUE(fits_glb(50'000'000, 100'000'000));
  EXPECT_FALSE(fits_glb(70'000'000, 200'000'000));
}

}  // namespace
}  // namespace fringeslam

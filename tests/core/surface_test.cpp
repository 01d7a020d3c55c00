// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <assimp/Importer.hpp>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>

#include "core/io/glb.h"
#include "core/io/ply.h"
#include "core/map/surface_fusion.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

support::Surface sphere(const Eigen::Vector3d& centre, double radius) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const Eigen::Vector3d to = origin - centre;
    const double a = direction.squaredNorm(), b = to.dot(direction), c = to.squaredNorm() - radius * radius;
    if (b * b < a * c) return std::nullopt;
    const double distance = (-b - std::sqrt(b * b - a * c)) / a;
    const Eigen::Vector3d point = origin + distance * direction;
    return support::Hit{distance, point, (point - centre) / radius};
  };
}

// The square |x|, |y| < half in the plane z = depth.
support::Surface square(double depth, double half) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const double distance = (depth - origin.z()) / direction.z();
    const Eigen::Vector3d point = origin + distance * direction;
    if (point.head<2>().cwiseAbs().maxCoeff() >= half) return std::nullopt;
    return support::Hit{distance, point, {0, 0, -1}};
  };
}

void erase(Frame& frame, int row, int col) {
  frame.points_m(row, col) = frame.normals(row, col) = cv::Vec3f::all(kNaN);
  frame.sigma_m(row, col) = kNaN;
}

Eigen::Vector3d corner(const SurfaceMesh& mesh, const std::array<uint32_t, 3>& triangle, size_t i) {
  return mesh.vertices[triangle[i]].position_m.cast<double>();
}

Eigen::Vector3d area_vector(const SurfaceMesh& mesh, const std::array<uint32_t, 3>& triangle) {
  const Eigen::Vector3d p = corner(mesh, triangle, 0);
  return 0.5 * (corner(mesh, triangle, 1) - p).cross(corner(mesh, triangle, 2) - p);
}

// Every triangle faces the side of its vertices' normals, every vertex is used, and no directed edge occurs twice: the
// triangles form one oriented surface.
void expect_oriented(const SurfaceMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> passes;
  std::vector<bool> used(mesh.vertices.size());
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d area = area_vector(mesh, triangle);
    for (size_t i = 0; i < 3; ++i) {
      used[triangle[i]] = true;
      ASSERT_GT(area.dot(mesh.vertices[triangle[i]].normal.cast<double>()), -1e-12);
      ASSERT_EQ(++passes[std::pair(triangle[i], triangle[(i + 1) % 3])], 1);
    }
  }
  EXPECT_EQ(std::count(used.begin(), used.end(), false), 0);
}

// A connected part of the mesh; its Euler number (vertices - edges + triangles) is 1 for a disc and 0 for a ring.
struct Part {
  double depth_m = 0;  // of an arbitrary vertex
  int euler = 0, boundary_edges = 0;
};

std::vector<Part> parts_of(const SurfaceMesh& mesh) {
  std::vector<uint32_t> root(mesh.vertices.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](uint32_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  std::map<std::pair<uint32_t, uint32_t>, int> uses;
  for (const auto& triangle : mesh.triangles) {
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t a = triangle[i], b = triangle[(i + 1) % 3];
      ++uses[std::minmax(a, b)];
      root[find(a)] = find(b);
    }
  }
  std::map<uint32_t, Part> parts;
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    parts[find(v)].depth_m = static_cast<double>(mesh.vertices[v].position_m.z());
    ++parts[find(v)].euler;
  }
  for (const auto& [edge, count] : uses) {
    --parts[find(edge.first)].euler;
    parts[find(edge.first)].boundary_edges += count == 1 ? 1 : 0;
  }
  for (const auto& triangle : mesh.triangles) ++parts[find(triangle[0])].euler;
  std::vector<Part> list;
  for (const auto& part : parts) list.push_back(part.second);
  std::sort(list.begin(), list.end(), [](const Part& a, const Part& b) { return a.depth_m < b.depth_m; });
  return list;
}

double longest_edge(const SurfaceMesh& mesh) {
  double longest = 0;
  for (const auto& triangle : mesh.triangles) {
    for (size_t i = 0; i < 3; ++i)
      longest = std::max(longest, (corner(mesh, triangle, i) - corner(mesh, triangle, (i + 1) % 3)).norm());
  }
  return longest;
}

SurfaceModel model_of(const support::Surface& surface, const RigModel& rig, const SurfaceOptions& options = {}) {
  SurfaceModel model(rig, options);
  model.add(support::observe(surface, rig, {}, 1e-4), {});
  return model;
}

TEST(Surface, ObliquePlaneIsReproduced) {
  const RigModel rig = support::small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, -1).normalized();
  SurfaceModel model(rig, {});
  for (int i = 0; i < 3; ++i) {
    const Pose pose = pose_from({{7.0 * i, -5.0 * i, 3.0 * i}, {3.0 * i, 2.0 * i, 10.0 * i}});
    model.add(support::observe(support::plane(normal, -1), rig, pose, 1e-5), pose);
  }
  const SurfaceMesh mesh = model.mesh();
  ASSERT_GT(mesh.vertices.size(), 10000U);
  double sum = 0, worst = 0;
  for (const CloudPoint& vertex : mesh.vertices) {
    const double off = normal.dot(vertex.position_m.cast<double>()) + 1;
    sum += off;
    worst = std::max(worst, std::abs(off));
    ASSERT_GT(vertex.normal.cast<double>().dot(normal), 1 - 1e-6);
    ASSERT_EQ(vertex.grey, 128);
  }
  // Rounding: a distance step is 3 * 2 mm / 32767 = 0.19 um, and a float at 1 m is accurate to 0.06 um.
  EXPECT_LT(std::abs(sum) / static_cast<double>(mesh.vertices.size()), 1e-7);
  EXPECT_LT(worst, 8e-7);
  expect_oriented(mesh);
  Eigen::Vector3d vector = Eigen::Vector3d::Zero();
  double area = 0;
  for (const auto& triangle : mesh.triangles) {
    vector += area_vector(mesh, triangle);
    area += area_vector(mesh, triangle).norm();
  }
  EXPECT_NEAR(vector.dot(normal) / area, 1, 1e-5);  // flat and without overlap
  const auto parts = parts_of(mesh);
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_EQ(parts[0].euler, 1);
}

// A column of pixels too close to an edge for normals of their own, on the surface or off it.
TEST(Surface, PixelsWithoutANormalAreUsedWhereTheyLieOnANeighboursPlane) {
  const RigModel rig = support::small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, -1).normalized();
  constexpr float kSigma = 1e-4f;
  const Frame whole = support::observe(support::plane(normal, -1), rig, {}, static_cast<double>(kSigma));
  const auto voxels = [&](float off_sigmas, double max_off_plane_sigma) {
    Frame frame = whole;
    frame.points_m = whole.points_m.clone();
    frame.normals = whole.normals.clone();
    const int col = rig.camera.width / 2;
    for (int row = 0; row < rig.camera.height; ++row) {
      frame.points_m(row, col) *= 1 + off_sigmas * kSigma / frame.points_m(row, col)[2];
      frame.normals(row, col) = cv::Vec3f::all(kNaN);
    }
    SurfaceModel model(rig, {.max_off_plane_sigma = max_off_plane_sigma});
    model.add(frame, {});
    return model.voxels();
  };
  SurfaceModel model(rig, {});
  model.add(whole, {});
  EXPECT_EQ(voxels(0, 2.5), model.voxels());
  EXPECT_LT(voxels(0, 0), model.voxels());
  // Both pixels contribute to the distance: sqrt(2) times the sigmas of one.
  EXPECT_GT(voxels(3.4f, 2.5), voxels(0, 0));
  EXPECT_EQ(voxels(3.7f, 2.5), voxels(0, 0));
}

TEST(Surface, SphereIsReproducedToTheSquareOfTheVoxel) {
  // Up to 60 degrees from the ray, with a = voxel^2 / radius: half a pixel's diagonal (1.41 voxels on the slope) away,
  // a pixel's tangent plane deviates from the sphere by at most 1.0 a; a voxel's distance to it, at one voxel's depth
  // and that slope, is at most 1.5 a too large; and the mean of crossings up to sqrt(3) / 2 voxels apart lies at most
  // 3/8 a inside. The first two are outside. Their means over a pixel and a cell are about a third of that.
  for (const double radius : {0.04, 0.08}) {
    const RigModel rig = support::small_rig(true);
    const Eigen::Vector3d centre(0.01, -0.007, 1.0);
    const SurfaceModel model = model_of(sphere(centre, radius), rig, {.max_slope_deg = 60});
    const SurfaceMesh mesh = model.mesh();
    ASSERT_GT(mesh.vertices.size(), 800U);
    const double unit = model.voxel_m() * model.voxel_m() / radius;
    double sum = 0;
    for (const CloudPoint& vertex : mesh.vertices) {
      const Eigen::Vector3d from_centre = vertex.position_m.cast<double>() - centre;
      const double off = from_centre.norm() - radius;
      ASSERT_LT(off, 2.5 * unit);
      ASSERT_GT(off, -0.5 * unit);
      ASSERT_GT(from_centre.normalized().dot(vertex.normal.cast<double>()), std::cos(4 * model.voxel_m() / radius));
      sum += off;
    }
    const double mean = sum / static_cast<double>(mesh.vertices.size());
    EXPECT_LT(std::abs(mean), 0.25 * unit);
    expect_oriented(mesh);
    // The cap is a disc, since its back is open; at its rim a quad may be separate.
    int caps = 0;
    for (const Part& part : parts_of(mesh)) {
      EXPECT_EQ(part.euler, 1);
      caps += part.boundary_edges > 4 ? 1 : 0;
    }
    EXPECT_EQ(caps, 1);
  }
}

TEST(Surface, StepStaysOpen) {
  // A box's front before a wall: for each step of 10 to 80 mm the two sides stay separate, a disc and a ring around
  // its shadow.
  const RigModel rig = support::small_rig(false);
  for (const double step : {0.01, 0.03, 0.08}) {
    const SurfaceModel model =
        model_of(support::nearest_of({square(1.05 - step, 0.05), support::plane({0, 0, 1}, 1.05)}), rig);
    const SurfaceMesh mesh = model.mesh();
    expect_oriented(mesh);
    const auto parts = parts_of(mesh);
    ASSERT_EQ(parts.size(), 2U) << step;
    EXPECT_NEAR(parts[0].depth_m, 1.05 - step, 1e-6);
    EXPECT_NEAR(parts[1].depth_m, 1.05, 1e-6);
    EXPECT_EQ(parts[0].euler, 1);
    EXPECT_EQ(parts[1].euler, 0);
    // Once around the front and twice around the wall, in edges of the length of a voxel or a diagonal.
    EXPECT_GT(parts[0].boundary_edges, 0.4 / (1.5 * model.voxel_m()));
    EXPECT_GT(parts[1].boundary_edges, 1.2 / (1.5 * model.voxel_m()));
    EXPECT_LT(longest_edge(mesh), 1.5 * model.voxel_m());
  }
}

TEST(Surface, HoleStaysAHole) {
  const RigModel rig = support::small_rig(false);
  SurfaceModel model(rig, {});
  for (int view = 0; view < 3; ++view) {
    const Pose pose = pose_from({{2.0 * view, 1.0 * view, 0}, {0, 0, 0}});
    Frame frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, pose, 1e-4);
    for (int row = 50; row < 60; ++row) {
      for (int col = 50; col < 60; ++col) erase(frame, row - view / 2, col - view);
    }
    model.add(frame, pose);
  }
  const auto parts = parts_of(model.mesh());
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_EQ(parts[0].euler, 0);
}

double rms_off_plane(const SurfaceMesh& mesh, double depth, double& sigma_m) {
  double squares = 0;
  sigma_m = 0;
  for (const CloudPoint& vertex : mesh.vertices) {
    squares += std::pow(static_cast<double>(vertex.position_m.z()) - depth, 2);
    sigma_m += static_cast<double>(vertex.sigma_m) / static_cast<double>(mesh.vertices.size());
  }
  return std::sqrt(squares / static_cast<double>(mesh.vertices.size()));
}

TEST(Surface, NoiseAveragesDown) {
  // 12000 vertices of about one pixel each: the root mean square is known to 1 %, over 5 seeds to 0.5 %, the ratio of
  // two to 0.7 %.
  const RigModel rig = support::small_rig(false);
  double one = 0, sixteen = 0, sigma_one = 0, sigma_sixteen = 0;
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    support::Random random(seed);
    SurfaceModel model(rig, {});
    for (int view = 0; view < 16; ++view) {
      model.add(support::observe(support::plane({0, 0, 1}, 1.0503), rig, {}, 1e-4, &random), {});
      if (view == 0) one += rms_off_plane(model.mesh(), 1.0503, sigma_one) / 5;
    }
    sixteen += rms_off_plane(model.mesh(), 1.0503, sigma_sixteen) / 5;
  }
  EXPECT_NEAR(one / sixteen, 4, 0.15);
  EXPECT_NEAR(sigma_one, 1e-4, 1e-7);
  EXPECT_NEAR(sigma_one / sigma_sixteen, 4, 1e-3);
  // A vertex averages the measurements of up to four pixels, but its sigma is that of one.
  EXPECT_LT(one, 1.02e-4);
  EXPECT_GT(one, 0.45e-4);
}

TEST(Surface, FramesCountByTheirSigmas) {
  // Weights 1 and 1/100: a surface 0.5 mm farther away shifts the mean by 0.5 / 101 mm.
  const RigModel rig = support::small_rig(false);
  SurfaceModel model(rig, {});
  Frame good = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  Frame poor = support::observe(support::plane({0, 0, 1}, 1.0505), rig, {}, 1e-3);
  good.texture = uchar{50};
  poor.texture = uchar{151};
  model.add(good, {});
  model.add(poor, {});
  const SurfaceMesh mesh = model.mesh();
  ASSERT_GT(mesh.vertices.size(), 10000U);
  for (const CloudPoint& vertex : mesh.vertices) {
    ASSERT_NEAR(vertex.position_m.z(), 1.05 + 0.0005 / 101, 4e-7);
    ASSERT_NEAR(vertex.sigma_m, 1e-4 / std::sqrt(1.01), 1e-8);
    ASSERT_EQ(vertex.grey, 51);
  }
}

TEST(Surface, ObliqueMeasurementCountsByItsSigmaAlongTheNormal) {
  const RigModel rig = support::small_rig(false);
  const Eigen::Vector3d normal = Eigen::Vector3d(1, 0, -1).normalized();
  const SurfaceMesh mesh = model_of(support::plane(normal, normal.dot(Eigen::Vector3d(0, 0, 1))), rig).mesh();
  ASSERT_GT(mesh.vertices.size(), 5000U);
  for (const CloudPoint& vertex : mesh.vertices) {
    const Eigen::Vector3d point = vertex.position_m.cast<double>();
    // Over the two neighbouring pixels the ray is constant to 0.3 %.
    ASSERT_NEAR(vertex.sigma_m, -normal.dot(point) / point.z() * 1e-4, 5e-7);
  }
}

TEST(Surface, PoorMeasurementsBecomeNoTriangles) {
  const RigModel rig = support::small_rig(false);
  SurfaceModel model(rig, {.max_sigma_m = 8e-5});
  const Frame frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  model.add(frame, {});
  EXPECT_TRUE(model.mesh().triangles.empty());
  model.add(frame, {});  // 7.07e-5
  EXPECT_GT(model.mesh().triangles.size(), 10000U);
}

std::vector<std::pair<Frame, Pose>> views_of_a_corner(const RigModel& rig) {
  std::vector<std::pair<Frame, Pose>> views;
  support::Random random(3);
  for (int i = 0; i < 4; ++i) {
    const Pose pose = pose_from({{10.0 * i, -5.0 * i, 0}, {0, 0, 3.0 * i}});
    views.emplace_back(support::observe(support::corner({0, 0, 1.1}), rig, pose, 1e-5 * (i + 1), &random), pose);
  }
  return views;
}

// Equal up to rounding: a distance that rounds to the other side of zero moves a few vertices.
void expect_alike(const SurfaceMesh& a, const SurfaceMesh& b) {
  EXPECT_NEAR(static_cast<double>(a.vertices.size()), static_cast<double>(b.vertices.size()), 20);
  int likes = 0, all = 0;
  for (size_t i = 0; i < a.vertices.size(); i += 10, ++all) {
    likes += std::any_of(b.vertices.begin(), b.vertices.end(), [&](const CloudPoint& vertex) {
      return (vertex.position_m - a.vertices[i].position_m).norm() < 2e-6F;
    });
  }
  EXPECT_GT(all, 1000);
  EXPECT_GE(likes, all * 0.995);
}

TEST(Surface, OrderOfFramesMattersByRoundingAlone) {
  const RigModel rig = support::small_rig(true);
  const auto views = views_of_a_corner(rig);
  SurfaceModel forward(rig, {}), backward(rig, {});
  for (const auto& [frame, pose] : views) forward.add(frame, pose);
  for (auto view = views.rbegin(); view != views.rend(); ++view) backward.add(view->first, view->second);
  EXPECT_EQ(forward.voxels(), backward.voxels());
  EXPECT_EQ(forward.memory_bytes(), backward.memory_bytes());
  expect_alike(forward.mesh(), backward.mesh());
}

TEST(Surface, FramesAtOnceAreFramesOneAfterTheOther) {
  const RigModel rig = support::small_rig(true);
  std::vector<PosedFrame> views;
  for (int i = 0; i < 3; ++i) {  // twelve, more than are fused at a time
    for (const auto& [frame, pose] : views_of_a_corner(rig)) views.push_back({frame, pose});
  }
  ASSERT_GT(views.size(), static_cast<size_t>(kMaxFusedFrames));
  SurfaceModel together(rig, {}), singly(rig, {});
  together.add(views);
  for (const PosedFrame& view : views) singly.add(view.frame, view.world_from_camera);
  EXPECT_EQ(together.voxels(), singly.voxels());
  EXPECT_EQ(together.memory_bytes(), singly.memory_bytes());
  expect_alike(together.mesh(), singly.mesh());
}

// No voxel may be lost when octants are found by squares of pixels: steps everywhere and pixels without depth.
TEST(Surface, EveryVoxelOfTheBandIsWritten) {
  const RigModel rig = support::small_rig(true);
  Frame frame = support::observe(support::plane({0.3, -0.2, -1}, -1), rig, {}, 1e-4);
  support::Random random(7);
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      frame.points_m(row, col) *= static_cast<float>(0.8 + 0.05 * std::floor(random.uniform(0, 8)));
      if (random.uniform(0, 1) < 0.3) erase(frame, row, col);
    }
  }
  SurfaceModel whole(rig, {});
  whole.add(frame, {});
  // One pixel of each 2 x 2 square in turn: together they must write the same voxels as the whole frame.
  SurfaceModel parts(rig, {});
  for (int kept = 0; kept < 4; ++kept) {
    Frame one = frame;
    one.points_m = frame.points_m.clone(), one.normals = frame.normals.clone(), one.sigma_m = frame.sigma_m.clone();
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        if (row % 2 * 2 + col % 2 != kept) erase(one, row, col);
      }
    }
    parts.add(one, {});
  }
  EXPECT_GT(whole.voxels(), 10000U);
  EXPECT_EQ(whole.voxels(), parts.voxels());
}

TEST(Surface, NumberOfThreadsDoesNotMatter) {
  const RigModel rig = support::small_rig(true);
  const auto views = views_of_a_corner(rig);
  std::string before;
  const int threads = cv::getNumThreads();
  for (const int number : {1, 2}) {
    cv::setNumThreads(number);
    SurfaceModel model(rig, {});
    for (const auto& [frame, pose] : views) model.add(frame, pose);
    const std::string ply = to_ply(model.mesh(), "world");
    EXPECT_TRUE(before.empty() || ply == before);
    before = ply;
  }
  cv::setNumThreads(threads);
}

TEST(Surface, InstructionSetsGiveTheSameBits) {
  const RigModel rig = support::small_rig(true);
  const auto views = views_of_a_corner(rig);
  std::vector<FramePlanes> frames;
  BrickSet touched;
  for (const auto& [frame, pose] : views) {
    frames.emplace_back(rig.camera, VoxelScale{0.002, 0.006}, PlaneLimits{});
    frames.back().take(frame, pose);
    frames.back().collect(static_cast<int>(frames.size()) - 1, touched);
  }
  std::vector<InstructionSet> sets = {InstructionSet::portable};
  if (widest_instruction_set() != InstructionSet::portable) sets.push_back(InstructionSet::avx2);
  if (widest_instruction_set() == InstructionSet::avx512) sets.push_back(InstructionSet::avx512);
  std::map<uint64_t, std::array<std::array<int64_t, kBrickVoxels>, 3>> bricks;
  for (const TouchedBrick& brick : touched.bricks()) {
    for (size_t i = 0; i < sets.size(); ++i) fuse(frames, brick, bricks[brick.key][i].data(), sets[i]);
  }
  ASSERT_GT(bricks.size(), 100U);
  for (const auto& brick : bricks) {
    for (size_t i = 1; i < sets.size(); ++i) ASSERT_EQ(brick.second[i], brick.second[0]);
  }
}

TEST(Surface, MemoryGrowsWithTheSurface) {
  // A quarter of the image covers a quarter of the plane's area. The grid's overhead beyond its bricks is within 10 %.
  const RigModel rig = support::small_rig(false);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4123, -0.2371, -1).normalized();
  const Frame whole = support::observe(support::plane(normal, -1), rig, {}, 1e-4);
  Frame quarter = support::observe(support::plane(normal, -1), rig, {}, 1e-4);
  for (int row = 0; row < quarter.height(); ++row) {
    for (int col = 0; col < quarter.width(); ++col) {
      if (std::abs(row - 62) > 31 || std::abs(col - 66) > 33) erase(quarter, row, col);
    }
  }
  SurfaceModel small(rig, {.voxel_m = 0.0005}), large(rig, {.voxel_m = 0.0005});
  small.add(quarter, {});
  large.add(whole, {});
  const auto ratio = [](size_t a, size_t b) { return static_cast<double>(a) / static_cast<double>(b); };
  const double area = (133.0 * 125) / (67.0 * 63);
  EXPECT_NEAR(ratio(large.voxels(), small.voxels()), area, 0.1 * area);
  EXPECT_NEAR(ratio(large.memory_bytes(), small.memory_bytes()), area, 0.1 * area);
  const size_t voxels = small.voxels(), bytes = small.memory_bytes();
  for (int i = 0; i < 9; ++i) small.add(quarter, {});
  EXPECT_EQ(small.voxels(), voxels);
  EXPECT_EQ(small.memory_bytes(), bytes);
  // Six voxels deep, below the area seen by the pixels: z^2 / (f^2 cos) each, with cos = |n . r| of the rays r with
  // r.z = 1.
  double seen_m2 = 0;
  for (const cv::Vec3f& point : whole.points_m) {
    const Eigen::Vector3d p(point[0], point[1], point[2]);
    seen_m2 += std::pow(p.z(), 3) / (511.5 * 511.5 * std::abs(normal.dot(p)));
  }
  EXPECT_NEAR(static_cast<double>(large.voxels()) * std::pow(0.0005, 3) / 0.003, seen_m2, 0.01 * seen_m2);
}

TEST(Surface, FrameWithoutPointsAddsNothing) {
  const RigModel rig = support::small_rig(false);
  Frame frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  SurfaceModel model(rig, {});
  frame.normals = cv::Vec3f::all(kNaN);
  model.add(frame, {});
  frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  frame.points_m = cv::Vec3f::all(kNaN);
  model.add(frame, {});
  EXPECT_EQ(model.voxels(), 0U);
  EXPECT_TRUE(model.mesh().vertices.empty());
  EXPECT_TRUE(model.mesh().triangles.empty());
}

TEST(Surface, WorldMayBeAnywhere) {
  // Near the world's origin and far from it: the same surface, up to the rounding of coordinates.
  const RigModel rig = support::small_rig(false);
  const Frame frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  for (const double x : {0.0, 50.0, -300.0}) {
    const Eigen::Vector3d shift(x, 0, -1.05);
    SurfaceModel model(rig, {});
    model.add(frame, {Eigen::Matrix3d::Identity(), shift});
    const SurfaceMesh mesh = model.mesh();
    const auto parts = parts_of(mesh);
    ASSERT_EQ(parts.size(), 1U);
    EXPECT_EQ(parts[0].euler, 1);
    EXPECT_GT(mesh.vertices.size(), 15000U);
    for (const CloudPoint& vertex : mesh.vertices) ASSERT_NEAR(vertex.position_m.z(), 0, 1e-6);
  }
}

TEST(Surface, VoxelIsAPixelAtMidRange) {
  RigModel rig = support::small_rig(false);
  EXPECT_NEAR(SurfaceModel(rig, {}).voxel_m(), 1.05 / 511.5, 1e-12);
  EXPECT_EQ(SurfaceModel(rig, {.voxel_m = 0.001}).voxel_m(), 0.001);
}

TEST(Surface, InvalidInputIsRefused) {
  const RigModel rig = support::small_rig(false);
  EXPECT_THAT(error_of([&] { SurfaceModel(rig, {.voxel_m = -1}); }),
              HasSubstr("surface.voxel_m is -1; it must lie in"));
  EXPECT_THAT(error_of([&] { SurfaceModel(rig, {.truncation_voxels = 1}); }),
              HasSubstr("surface.truncation_voxels is 1; it must lie in"));
  SurfaceModel model(rig, {});
  Frame frame = support::observe(support::plane({0, 0, 1}, 1.05), rig, {}, 1e-4);
  EXPECT_THAT(error_of([&] {
                model.add(frame, {Eigen::Matrix3d::Identity(), {0, 1e5, 0}});
              }),
              HasSubstr("surface: a pose is not within"));
  EXPECT_THAT(error_of([&] {
                model.add(frame, {Eigen::Matrix3d::Identity(), {0, static_cast<double>(kNaN), 0}});
              }),
              HasSubstr("surface: a pose is not within"));
  frame.points_m = frame.points_m.rowRange(0, 100).clone();
  EXPECT_THAT(error_of([&] { model.add(frame, {}); }), HasSubstr("surface: the frame is 133x100, the camera 133x125"));
}

template <class Value>
Value read_at(const std::string& bytes, size_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

SurfaceMesh small_mesh() {
  SurfaceMesh mesh;
  mesh.vertices = {{{1, 2, 3}, {0, 0, -1}, 7, 0.5F},
                   {{-4, 5, 6}, {0, 1, 0}, 255, 0.25F},
                   {{0.1F, -5, 6.5F}, {1, 0, 0}, 0, 0.125F},
                   {{2, 2, 2}, {1, 0, 0}, 9, 0.125F}};
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}};
  return mesh;
}

TEST(Surface, PlyIsHeaderVerticesAndFaces) {
  const std::string ply = to_ply(small_mesh(), "world");
  const size_t end = ply.find("end_header\n") + 11;
  EXPECT_THAT(ply, testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(ply, HasSubstr("\ncomment world frame, metres\nelement vertex 4\n"));
  EXPECT_THAT(ply, HasSubstr("\nproperty float sigma\nelement face 2\nproperty list uchar int vertex_indices\n"));
  ASSERT_EQ(ply.size(), end + 4 * (6 * 4 + 3 + 4) + 2 * (1 + 3 * 4));
  EXPECT_EQ(read_at<float>(ply, end + 31), -4);
  EXPECT_EQ(read_at<float>(ply, end + 31 + 27), 0.25F);
  EXPECT_EQ(read_at<uint8_t>(ply, end + 4 * 31), 3);
  EXPECT_EQ(read_at<int32_t>(ply, end + 4 * 31 + 5), 2);
}

struct Glb {
  nlohmann::json json;
  std::string binary;
};

// Parses a GLB file, checking header and chunks.
Glb parse_glb(const std::string& file) {
  EXPECT_EQ(file.substr(0, 4), "glTF");
  EXPECT_EQ(read_at<uint32_t>(file, 4), 2U);
  EXPECT_EQ(read_at<uint32_t>(file, 8), file.size());
  const auto json_size = read_at<uint32_t>(file, 12);
  EXPECT_EQ(json_size % 4, 0U);
  EXPECT_EQ(file.substr(16, 4), "JSON");
  Glb glb{nlohmann::json::parse(file.substr(20, json_size)), ""};
  const size_t next = 20 + json_size;
  if (next == file.size()) return glb;
  const auto binary_size = read_at<uint32_t>(file, next);
  EXPECT_EQ(binary_size % 4, 0U);
  EXPECT_EQ(file.substr(next + 4, 4), std::string("BIN\0", 4));
  EXPECT_EQ(next + 8 + binary_size, file.size());
  glb.binary = file.substr(next + 8);
  return glb;
}

TEST(Surface, GlbIsWhatGltfSays) {
  const SurfaceMesh mesh = small_mesh();
  const Glb glb = parse_glb(to_glb(mesh));
  EXPECT_EQ(glb.json.at("asset").at("version"), "2.0");
  ASSERT_EQ(glb.json.at("buffers").size(), 1U);
  EXPECT_EQ(glb.json["buffers"][0].at("byteLength"), glb.binary.size());
  const auto& primitive = glb.json.at("meshes").at(0).at("primitives").at(0);
  const auto start = [&](const nlohmann::json& accessor, size_t bytes, size_t count, int component,
                         const std::string& type) {
    const auto& described = glb.json.at("accessors").at(accessor.get<size_t>());
    const auto& view = glb.json.at("bufferViews").at(described.at("bufferView").get<size_t>());
    EXPECT_EQ(described.at("count"), count);
    EXPECT_EQ(described.at("componentType"), component);
    EXPECT_EQ(described.at("type"), type);
    EXPECT_EQ(view.at("byteLength"), bytes * count);
    const auto offset = view.value("byteOffset", size_t{0});
    EXPECT_EQ(offset % 4, 0U);
    EXPECT_LE(offset + bytes * count, glb.binary.size());
    return offset;
  };
  const auto& attributes = primitive.at("attributes");
  const size_t position = start(attributes.at("POSITION"), 12, 4, 5126, "VEC3");
  const size_t normal = start(attributes.at("NORMAL"), 12, 4, 5126, "VEC3");
  const size_t colour = start(attributes.at("COLOR_0"), 4, 4, 5121, "VEC4");
  const size_t sigma = start(attributes.at("_SIGMA"), 4, 4, 5126, "SCALAR");
  const size_t index = start(primitive.at("indices"), 4, 6, 5125, "SCALAR");
  for (size_t v = 0; v < 4; ++v) {
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(read_at<float>(glb.binary, position + 12 * v + 4 * i),
                mesh.vertices[v].position_m[static_cast<Eigen::Index>(i)]);
      EXPECT_EQ(read_at<float>(glb.binary, normal + 12 * v + 4 * i),
                mesh.vertices[v].normal[static_cast<Eigen::Index>(i)]);
      EXPECT_EQ(read_at<uint8_t>(glb.binary, colour + 4 * v + i), mesh.vertices[v].grey);
    }
    EXPECT_EQ(read_at<uint8_t>(glb.binary, colour + 4 * v + 3), 255);
    EXPECT_EQ(read_at<float>(glb.binary, sigma + 4 * v), mesh.vertices[v].sigma_m);
  }
  for (size_t i = 0; i < 6; ++i) EXPECT_EQ(read_at<uint32_t>(glb.binary, index + 4 * i), mesh.triangles[i / 3][i % 3]);
  const auto& bounds = glb.json["accessors"][attributes["POSITION"].get<size_t>()];
  EXPECT_EQ(bounds.at("min").get<std::vector<float>>(), (std::vector<float>{-4, -5, 2}));
  EXPECT_EQ(bounds.at("max").get<std::vector<float>>(), (std::vector<float>{2, 5, 6.5F}));
  EXPECT_TRUE(glb.json["accessors"][attributes["COLOR_0"].get<size_t>()].at("normalized"));
  // x, y, z, w: the world's z axis becomes y.
  const auto turn = glb.json.at("nodes").at(0).at("rotation").get<std::vector<double>>();
  const Eigen::Quaterniond rotation(turn[3], turn[0], turn[1], turn[2]);
  EXPECT_LT((rotation * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitY()).norm(), 1e-12);

  const Glb empty = parse_glb(to_glb(SurfaceMesh{}));
  EXPECT_EQ(empty.json.at("scenes").size(), 1U);
  EXPECT_TRUE(empty.json["scenes"][0].is_object());
  EXPECT_FALSE(empty.json.contains("meshes"));
}

TEST(Surface, EqualMeshesGiveEqualGlbFiles) { EXPECT_EQ(to_glb(small_mesh()), to_glb(small_mesh())); }

TEST(Surface, GlbIsReadByAssimp) {
  const RigModel rig = support::small_rig(false);
  const SurfaceMesh mesh = model_of(support::corner({0, 0, 1.1}), rig).mesh();
  const std::string glb = to_glb(mesh);
  Assimp::Importer importer;
  const aiScene* const scene = importer.ReadFileFromMemory(glb.data(), glb.size(), 0, "glb");
  ASSERT_NE(scene, nullptr) << importer.GetErrorString();
  ASSERT_EQ(scene->mNumMeshes, 1U);
  const aiMesh& read = *scene->mMeshes[0];
  ASSERT_EQ(read.mNumVertices, mesh.vertices.size());
  ASSERT_EQ(read.mNumFaces, mesh.triangles.size());
  ASSERT_TRUE(read.HasNormals() && read.HasVertexColors(0));
  for (size_t v = 0; v < mesh.vertices.size(); v += 97) {
    EXPECT_EQ(read.mVertices[v].z, mesh.vertices[v].position_m.z());
    EXPECT_EQ(read.mNormals[v].y, mesh.vertices[v].normal.y());
    EXPECT_NEAR(read.mColors[0][v].g, 128.0 / 255, 1e-6);
  }
  for (size_t i = 0; i < mesh.triangles.size(); i += 89) {
    for (unsigned k = 0; k < 3; ++k) EXPECT_EQ(read.mFaces[i].mIndices[k], mesh.triangles[i][k]);
  }
}

}  // namespace
}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/map/mesh.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cstring>
#include <limits>

#include "core/io/ply.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;

constexpr float kNoDepth = std::numeric_limits<float>::quiet_NaN();

// Points 1 mm apart at the given depths, seen from 1 m; each list is one row of pixels.
Frame grid(const std::vector<std::vector<float>>& depth_m) {
  const int rows = static_cast<int>(depth_m.size()), cols = static_cast<int>(depth_m.front().size());
  Frame frame;
  frame.points_m = cv::Mat3f(rows, cols);
  frame.texture = cv::Mat1b(rows, cols);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const float z = depth_m[static_cast<size_t>(row)][static_cast<size_t>(col)];
      frame.points_m(row, col) = {1e-3F * static_cast<float>(col) * z, 1e-3F * static_cast<float>(row) * z, z};
      frame.texture(row, col) = static_cast<uchar>(10 * row + col);
    }
  }
  return frame;
}

Eigen::Vector3d corner(const Mesh& mesh, const std::array<uint32_t, 3>& triangle, size_t i) {
  return mesh.vertices[triangle[i]].position_m.cast<double>();
}

Eigen::Vector3d area_vector(const Mesh& mesh, const std::array<uint32_t, 3>& triangle) {
  const Eigen::Vector3d p = corner(mesh, triangle, 0);
  return 0.5 * (corner(mesh, triangle, 1) - p).cross(corner(mesh, triangle, 2) - p);
}

TEST(Mesh, PlaneIsTwoTrianglesAPixelBlockThatFaceTheCamera) {
  const RigModel rig = support::small_rig(false);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, -1).normalized();
  const Frame frame = support::observe(support::plane(normal, -1), rig, {}, 0);
  const Mesh mesh = frame_mesh(frame, {});
  ASSERT_EQ(mesh.vertices.size(), frame.points_m.total());
  ASSERT_EQ(mesh.triangles.size(), 2U * static_cast<size_t>((frame.width() - 1) * (frame.height() - 1)));
  Eigen::Vector3d area = Eigen::Vector3d::Zero();
  double sum = 0;
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d part = area_vector(mesh, triangle);
    ASSERT_LT(part.dot(corner(mesh, triangle, 0)), 0) << "faces away from the camera";
    area += part;
    sum += part.norm();
  }
  // Flat and without overlap: the areas add up to that of one plane.
  EXPECT_NEAR(area.norm() / sum, 1, 1e-5);
  EXPECT_NEAR(area.normalized().dot(normal), 1, 1e-9);
}

TEST(Mesh, NoTriangleCrossesAStep) {
  // Two planes, 10 mm apart, with the step between columns 2 and 3: 5 blocks per row, one of which spans the step.
  const std::vector<float> row = {1, 1, 1, 1.01F, 1.01F, 1.01F};
  const Mesh mesh = frame_mesh(grid({row, row, row}), {});
  EXPECT_EQ(mesh.triangles.size(), 2U * 4 * 2);
  for (const auto& triangle : mesh.triangles) {
    const double z = corner(mesh, triangle, 0).z();
    for (size_t i = 1; i < 3; ++i) EXPECT_EQ(corner(mesh, triangle, i).z(), z);
  }
  // 10 mm over 1 mm is a slope of 84.3 degrees.
  EXPECT_EQ(frame_mesh(grid({row, row, row}), {.max_slope_deg = 83}).triangles.size(), 2U * 4 * 2);
  EXPECT_EQ(frame_mesh(grid({row, row, row}), {.max_slope_deg = 86}).triangles.size(), 2U * 5 * 2);
  EXPECT_EQ(frame_mesh(grid({row, row, row}), {.max_slope_deg = 86, .max_step_m = 0.009}).triangles.size(), 2U * 4 * 2);
}

TEST(Mesh, BlockWithoutOneCornerIsTheTriangleOfTheOtherThree) {
  for (int missing = 0; missing < 4; ++missing) {
    Frame frame = grid({{1, 1}, {1, 1}});
    frame.points_m(missing / 2, missing % 2) = cv::Vec3f::all(kNoDepth);
    const Mesh mesh = frame_mesh(frame, {});
    ASSERT_EQ(mesh.triangles.size(), 1U) << missing;
    EXPECT_EQ(mesh.vertices.size(), 3U);
    EXPECT_LT(area_vector(mesh, mesh.triangles[0]).z(), 0) << missing;
    for (const MeshVertex& vertex : mesh.vertices) EXPECT_TRUE(vertex.position_m.allFinite());
  }
  Frame frame = grid({{1, kNoDepth}, {kNoDepth, 1}});
  EXPECT_TRUE(frame_mesh(frame, {}).triangles.empty());
  EXPECT_TRUE(frame_mesh(frame, {}).vertices.empty());
}

TEST(Mesh, BlockIsCutAlongItsShorterDiagonal) {
  // One corner is 2 mm nearer: the diagonal that separates it is the shorter one.
  for (int raised = 0; raised < 4; ++raised) {
    Frame frame = grid({{1, 1}, {1, 1}});
    frame.points_m(raised / 2, raised % 2)[2] -= 0.002F;
    const Mesh mesh = frame_mesh(frame, {.max_slope_deg = 89});
    ASSERT_EQ(mesh.triangles.size(), 2U);
    int of_raised = 0;
    for (const auto& triangle : mesh.triangles)
      of_raised += static_cast<int>(std::count(triangle.begin(), triangle.end(), static_cast<uint32_t>(raised)));
    EXPECT_EQ(of_raised, 1) << raised;
  }
}

TEST(Mesh, VerticesCarryTheirPixelsGreyValue) {
  const Mesh mesh = frame_mesh(grid({{1, 1, 1}, {1, 1, 1}}), {});
  ASSERT_EQ(mesh.vertices.size(), 6U);
  for (size_t i = 0; i < 6; ++i) EXPECT_EQ(mesh.vertices[i].grey, 10 * (i / 3) + i % 3);
}

TEST(Mesh, LimitsAreChecked) {
  EXPECT_THAT(error_of([] {
                frame_mesh(grid({{1, 1}, {1, 1}}), {.max_slope_deg = 0});
              }),
              HasSubstr("mesh.max_slope_deg is 0; it must lie in"));
}

template <class Value>
Value read_at(const std::string& bytes, size_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(Mesh, PlyIsHeaderVerticesAndFaces) {
  Mesh mesh;
  mesh.vertices = {{{1, 2, 3}, 7}, {{4, 5, 6}, 8}, {{-7, 8, 9}, 255}};
  mesh.triangles = {{0, 2, 1}};
  const std::string ply = to_ply(mesh, "camera");
  const size_t end = ply.find("end_header\n") + 11;
  const std::string header = ply.substr(0, end);
  EXPECT_THAT(header, testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(
      header,
      HasSubstr(
          "\ncomment camera frame, metres\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
          "property uchar red\nproperty uchar green\nproperty uchar blue\n"));
  EXPECT_THAT(header, HasSubstr("\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"));
  constexpr size_t kVertex = 3 * 4 + 3, kFace = 1 + 3 * 4;
  ASSERT_EQ(ply.size(), end + 3 * kVertex + kFace);
  EXPECT_EQ(read_at<float>(ply, end + 2 * kVertex), -7);
  EXPECT_EQ(read_at<uint8_t>(ply, end + 3 * kVertex - 1), 255);
  const size_t face = end + 3 * kVertex;
  EXPECT_EQ(read_at<uint8_t>(ply, face), 3);
  EXPECT_EQ(read_at<int32_t>(ply, face + 1), 0);
  EXPECT_EQ(read_at<int32_t>(ply, face + 5), 2);
  EXPECT_EQ(read_at<int32_t>(ply, face + 9), 1);
}

}  // namespace
}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/map/cloud.h"

#include <gmock/gmock.h>

#include <cstring>
#include <limits>

#include "core/io/ply.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::MatrixNear;
using testing::HasSubstr;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

struct Sample {
  Eigen::Vector3d point;
  double sigma_m = 1e-3;
  uchar grey = 100;
  Eigen::Vector3d normal = {0, 0, -1};
};

cv::Vec3f to_cv(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

// A frame with a single row.
Frame frame_of(const std::vector<Sample>& samples) {
  const cv::Size size(static_cast<int>(samples.size()), 1);
  Frame frame;
  frame.texture = cv::Mat1b(size);
  frame.points_m = cv::Mat3f(size);
  frame.normals = cv::Mat3f(size);
  frame.sigma_m = cv::Mat1f(size);
  for (int i = 0; i < size.width; ++i) {
    const Sample& sample = samples[static_cast<size_t>(i)];
    frame.texture(0, i) = sample.grey;
    frame.points_m(0, i) = to_cv(sample.point);
    frame.normals(0, i) = to_cv(sample.normal);
    frame.sigma_m(0, i) = static_cast<float>(sample.sigma_m);
  }
  return frame;
}

std::vector<CloudPoint> cloud_of(const Frame& frame, const Pose& world_from_camera, double cell_m) {
  CloudMap map(cell_m);
  map.add(frame, world_from_camera);
  return map.points();
}

TEST(Cloud, PointsOfACellAreAveragedByTheirSigmas) {
  // Weights 1 and 1/4: position and grey value at 1/5 of the way; sigma = 1 / sqrt(1.25) mm.
  const Sample good{{0.051, 0.052, 1.053}, 1e-3, 100, Eigen::Vector3d(1, 0, -1).normalized()};
  const Sample poor{{0.056, 0.057, 1.058}, 2e-3, 200, Eigen::Vector3d(1, 0, -1).normalized()};
  const auto points = cloud_of(frame_of({good, poor}), {}, 0.01);
  ASSERT_EQ(points.size(), 1U);
  EXPECT_THAT(points[0].position_m, MatrixNear(Eigen::Vector3f(0.052F, 0.053F, 1.054F), 1e-6F));
  EXPECT_EQ(points[0].grey, 120);
  EXPECT_NEAR(points[0].sigma_m, 1e-3 / std::sqrt(1.25), 1e-8);
  EXPECT_THAT(points[0].normal, MatrixNear(Eigen::Vector3f(0.70710678F, 0, -0.70710678F), 1e-6F));
}

TEST(Cloud, CellsDoNotReachAcrossZeroOrEachOther) {
  const auto points = cloud_of(
      frame_of({{{-0.001, 0.001, 1.001}}, {{0.001, 0.001, 1.001}}, {{0.001, 0.001, 1.012}}, {{0.009, 0.009, 1.009}}}),
      {}, 0.01);
  ASSERT_EQ(points.size(), 3U);
  EXPECT_LT(points[0].position_m.x(), 0);
  EXPECT_NEAR(points[1].position_m.x(), 0.005, 1e-6);
  EXPECT_NEAR(points[2].position_m.z(), 1.012, 1e-6);
}

TEST(Cloud, PointsAndNormalsAreOfTheWorld) {
  const Pose world_from_camera = pose_from({{100, 200, 300}, {0, 0, 90}});
  const auto points = cloud_of(frame_of({{{0.015, 0.025, 1}, 1e-3, 50, Eigen::Vector3d(1, 0, -1).normalized()}}),
                               world_from_camera, 0.1);
  ASSERT_EQ(points.size(), 1U);
  EXPECT_THAT(points[0].position_m, MatrixNear(Eigen::Vector3f(0.075F, 0.215F, 1.3F), 1e-6F));
  EXPECT_THAT(points[0].normal, MatrixNear(Eigen::Vector3f(0, 0.70710678F, -0.70710678F), 1e-6F));
}

TEST(Cloud, PixelsWithoutPointOrNormalAreLeftOut) {
  const Eigen::Vector3d nan = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(cloud_of(frame_of({{nan, kNaN, 0, nan}, {{0, 0, 1}, 1e-3, 0, nan}, {{0, 0, 2}}}), {}, 0.01).size(), 1U);
}

TEST(Cloud, OrderOfInsertionDoesNotMatter) {
  const RigModel rig = support::small_rig(false);
  const auto view = [&](int i) {
    const Pose pose = pose_from({{10.0 * i, -5.0 * i, 0}, {0, 0, 3.0 * i}});
    return std::pair(support::observe(support::corner({0, 0, 1.1}), rig, pose, 1e-5 * (i + 1)), pose);
  };
  CloudMap forward(0.004), backward(0.004);
  for (int i = 0; i < 4; ++i) forward.add(view(i).first, view(i).second);
  for (int i = 3; i >= 0; --i) backward.add(view(i).first, view(i).second);
  const auto a = forward.points(), b = backward.points();
  ASSERT_EQ(a.size(), b.size());
  ASSERT_GT(a.size(), 1000U);
  for (size_t i = 0; i < a.size(); ++i) {
    ASSERT_THAT(a[i].position_m, MatrixNear(b[i].position_m, 1e-6F));
    ASSERT_THAT(a[i].normal, MatrixNear(b[i].normal, 1e-5F));
    ASSERT_NEAR(a[i].sigma_m, b[i].sigma_m, 1e-10);
  }
}

TEST(Cloud, RepeatedViewsMergeIntoTheSurface) {
  const RigModel rig = support::small_rig(false);
  support::Random random(1);
  CloudMap map(0.005);
  for (int i = 0; i < 10; ++i) map.add(support::observe(support::plane({0, 0, 1}, 1.0025), rig, {}, 1e-4, &random), {});
  double squares = 0, count = 0;
  for (const CloudPoint& point : map.points()) {
    squares += std::pow((point.position_m.z() - 1.0025) / point.sigma_m, 2);
    ++count;
  }
  EXPECT_NEAR(std::sqrt(squares / count), 1, 4 / std::sqrt(2 * count));  // the merged sigma is consistent
}

TEST(Cloud, CellSizeIsChecked) {
  EXPECT_THAT(error_of([] { CloudMap(0); }), HasSubstr("cloud.cell_m is 0; it must lie in"));
}

template <class Value>
Value read_at(const std::string& bytes, size_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(Cloud, PlyIsHeaderAndThirtyOneBytesAPoint) {
  const std::vector<CloudPoint> points = {{{1, 2, 3}, {0, 0, -1}, 7, 0.5F}, {{-4, 5, 6}, {0, 1, 0}, 255, 0.25F}};
  const std::string ply = to_ply(points, "world");
  const size_t end = ply.find("end_header\n") + 11;
  const std::string header = ply.substr(0, end);
  EXPECT_THAT(header, testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(header, HasSubstr("\ncomment world frame, metres\nelement vertex 2\n"));
  size_t last = 0;
  for (const char* name : {"float x", "float y", "float z", "float nx", "float ny", "float nz", "uchar red",
                           "uchar green", "uchar blue", "float sigma"}) {
    const size_t at = header.find(std::string("property ") + name + "\n");
    ASSERT_NE(at, std::string::npos) << name;
    EXPECT_GT(at, last) << name;
    last = at;
  }
  ASSERT_EQ(ply.size(), end + 2 * (6 * 4 + 3 + 4));
  EXPECT_EQ(read_at<float>(ply, end + 8), 3);
  EXPECT_EQ(read_at<float>(ply, end + 20), -1);
  EXPECT_EQ(read_at<uint8_t>(ply, end + 25), 7);
  EXPECT_EQ(read_at<float>(ply, end + 31), -4);
  EXPECT_EQ(read_at<uint8_t>(ply, end + 31 + 26), 255);
  EXPECT_EQ(read_at<float>(ply, end + 31 + 27), 0.25F);
  EXPECT_THAT(to_ply(std::vector<CloudPoint>{}, "world"), HasSubstr("\nelement vertex 0\n"));
}

}  // namespace
}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Map statistics against hand-computed values, and PLY files as written by other systems.
#include "core/score/map_score.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstring>

#include "core/score/ply_file.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(MapScore, ByHand) {
  // Accuracy: mean 3/5, squares 0 + 1 + 1 + 0 + 1 (mm). Completeness: the 90th percentile is 1 + 0.9 (3 - 1) mm.
  const MapScore score = score_map({0, 0.001, 0.001, 0, 0.001}, {0.003, 0.001}, 0.001);
  EXPECT_EQ(score.accuracy.points, 5u);
  EXPECT_DOUBLE_EQ(score.accuracy.mean_m, 0.0006);
  EXPECT_DOUBLE_EQ(score.accuracy.rms_m, std::sqrt(0.6) * 1e-3);
  EXPECT_DOUBLE_EQ(score.accuracy.median_m, 0.001);
  EXPECT_DOUBLE_EQ(score.completeness.p90_m, 0.0028);
  EXPECT_EQ(score.precision, 1);
  EXPECT_EQ(score.recall, 0.5);
  EXPECT_DOUBLE_EQ(score.f_score(), 2.0 / 3);
  EXPECT_EQ(score_map({1}, {1}, 0.001).f_score(), 0);
}

// A wall 1 m in front of the camera; of 8 x 8 pixels, the rows and columns 2 and 6 are sampled.
TEST(MapScore, OnlyWhatTheSensorSeesIsToBeFound) {
  RigModel rig;
  rig.camera = {8, 8, 100, 100, 3.5, 3.5, {}};
  rig.near_m = 0.5, rig.far_m = 2;
  TruthFrame truth;
  truth.depth_m = cv::Mat1f(8, 8, 1.0F);
  truth.normals = cv::Mat3f(8, 8, cv::Vec3f(0, 0, -1));
  truth.position_m = cv::Mat3f(8, 8, cv::Vec3f(1, 2, 3));
  truth.mask = cv::Mat1f(8, 8, kTruthSurface | kTruthInBeam);
  const auto seen = [&] {
    std::vector<Eigen::Vector3d> points;
    append_seen(truth, rig, pixel_rays(rig.camera), points);
    return points.size();
  };
  EXPECT_EQ(seen(), 4u);
  truth.mask(2, 2) += static_cast<float>(kTruthInShadow);
  truth.mask(2, 6) += static_cast<float>(kTruthMixed);
  EXPECT_EQ(seen(), 2u);
  truth.depth_m(6, 2) = 2.1F;
  EXPECT_EQ(seen(), 1u);
  truth.normals(6, 6) = {0.9962F, 0, -0.0872F};  // 85 degrees
  EXPECT_EQ(seen(), 0u);
}

template <class Value>
void put(std::string& bytes, Value value, bool big_endian) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof raw);
  if (big_endian) std::reverse(raw, raw + sizeof raw);
  bytes.append(raw, sizeof raw);
}

class PlyFile : public testing::Test {
 protected:
  test::fs::path file(const std::string& bytes) const {
    test::write_bytes(temp_ / "map.ply", bytes);
    return temp_ / "map.ply";
  }
  PlyMap read(const std::string& bytes) const { return read_ply(file(bytes)); }
  std::string error(const std::string& bytes) const {
    return error_of([&] { read(bytes); });
  }

 private:
  test::TempFolder temp_;
};

const std::string kHead = "ply\nformat ascii 1.0\ncomment by hand\n";
const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";
const std::string kFaces = "property list uchar int vertex_indices\n";

TEST_F(PlyFile, AsciiWithOtherPropertiesAndElements) {
  const PlyMap map =
      read(kHead + "obj_info none\nelement camera 1\nproperty float f\nelement vertex 5\nproperty uchar red\n" + kXyz +
           "property list uchar float weights\nelement face 2\nproperty uchar flag\n" + kFaces +
           "end_header\n1.5\n7 0 0 0 0\n7 1 0 0 2 0.5 0.5\n7 1 1 0 0\n7 0 1e0 -0 0\n7 +2 .5 3e-1 0\n"
           "1 4 0 1 2 3\n0 3 2 3 4\n");
  ASSERT_EQ(map.vertices.size(), 5u);
  EXPECT_EQ(map.vertices[4], Eigen::Vector3d(2, 0.5, 0.3));
  EXPECT_THAT(map.triangles, ElementsAre(Eigen::Vector3i(0, 1, 2), Eigen::Vector3i(0, 2, 3), Eigen::Vector3i(2, 3, 4)));
  EXPECT_EQ(map.dropped, 0u);
}

// 1000 elements with a count of two thousand million; iterating over them would not terminate in reasonable time.
TEST_F(PlyFile, ElementsOfNothingTakeNoTime) {
  std::string nothing;
  for (int i = 0; i < 1000; ++i) nothing += "element nothing 2147483647\n";
  EXPECT_EQ(read(kHead + nothing + "element vertex 1\n" + kXyz + "end_header\n1 2 3\n").vertices.size(), 1u);
}

TEST_F(PlyFile, BinaryOfEitherByteOrder) {
  for (const bool big : {false, true}) {
    const std::string format = std::string("ply\r\nformat binary_") + (big ? "big" : "little") + "_endian 1.0\r\n";
    std::string floats = format + "element vertex 3\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\n" +
                         "element face 1\r\nproperty list uint8 uint16 vertex_index\r\nend_header\r\n";
    for (const float v : {0.25F, 1.0F, -2.0F, 3.0F, 4.0F, 5.0F, 6.0F, 7.0F, 8.5F}) put(floats, v, big);
    put(floats, uint8_t{3}, big);
    for (const int corner : {2, 1, 0}) put(floats, static_cast<uint16_t>(corner), big);
    const PlyMap mesh = read(floats);
    ASSERT_EQ(mesh.vertices.size(), 3u);
    EXPECT_EQ(mesh.vertices[0], Eigen::Vector3d(0.25, 1, -2));
    EXPECT_EQ(mesh.vertices[2], Eigen::Vector3d(6, 7, 8.5));
    EXPECT_THAT(mesh.triangles, ElementsAre(Eigen::Vector3i(2, 1, 0)));

    std::string doubles = format + "element vertex 1\nproperty double z\nproperty int16 grey\nproperty double x\n" +
                          "property double y\nend_header\n";
    put(doubles, 0.1, big);
    put(doubles, int16_t{-3}, big);
    put(doubles, 1e6 + 1e-9, big);
    put(doubles, -0.3, big);
    const PlyMap cloud = read(doubles);
    ASSERT_EQ(cloud.vertices.size(), 1u);
    EXPECT_EQ(cloud.vertices[0], Eigen::Vector3d(1e6 + 1e-9, -0.3, 0.1));
    EXPECT_TRUE(cloud.triangles.empty());
  }
}

TEST_F(PlyFile, PointsThatWereNotMeasuredAreDropped) {
  const PlyMap map = read(kHead + "element vertex 4\n" + kXyz + "element face 2\n" + kFaces +
                          "end_header\n0 0 0\nnan nan nan\n1 0 0\n0 1 0\n3 0 2 3\n3 0 1 2\n");
  EXPECT_EQ(map.vertices.size(), 3u);
  EXPECT_EQ(map.dropped, 1u);
  EXPECT_THAT(map.triangles, ElementsAre(Eigen::Vector3i(0, 1, 2)));
}

TEST_F(PlyFile, IsKnownByItsFirstLine) {
  EXPECT_TRUE(is_ply(file("ply\r\n")));
  EXPECT_FALSE(is_ply(file("plywood\n")));
  EXPECT_FALSE(is_ply(file("0 0 0 0 0 0 0 1\n")));
  EXPECT_FALSE(is_ply("/nowhere.ply"));
}

TEST_F(PlyFile, ErrorsNameTheLine) {
  const std::string two = kHead + "element vertex 2\n" + kXyz;
  EXPECT_THAT(error("solid\n"), HasSubstr("map.ply:1: is not a PLY file"));
  EXPECT_THAT(error("ply\nformat ascii 1.0\nelement vertex 2\n"), HasSubstr("map.ply:3: the header has no end_header"));
  EXPECT_THAT(error("ply\nend_header\n"), HasSubstr("map.ply:2: the header has no format line"));
  EXPECT_THAT(error("ply\nformat utf8 1.0\nend_header\n"), HasSubstr("map.ply:2: unknown format 'utf8'"));
  EXPECT_THAT(error(kHead + "element vertex many\n"), HasSubstr("map.ply:4: 'many' is not a valid element count"));
  EXPECT_THAT(error(kHead + "property float x\n"), HasSubstr("map.ply:4: property before any element"));
  EXPECT_THAT(error(kHead + "element vertex 1\nproperty half x\n"), HasSubstr("map.ply:5: unknown type 'half'"));
  EXPECT_THAT(error(kHead + "elephant vertex 1\n"), HasSubstr("map.ply:4: unknown keyword 'elephant'"));
  EXPECT_THAT(error(kHead + "element vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n"),
              HasSubstr("the vertices have no 'z'"));
  EXPECT_THAT(error(two + "end_header\n0 0 0\n0 x 0\n"), HasSubstr("map.ply:10: invalid number"));
  EXPECT_THAT(error(two + "end_header\n0 0 0\n0 0\n"), HasSubstr("the file is truncated in element 'vertex'"));
  EXPECT_THAT(error(two + "element face 1\n" + kFaces + "end_header\n0 0 0\n1 0 0\n3 0 1 2\n"),
              HasSubstr("map.ply:13: there are 2 vertices, but a face refers to 2 in element 'face'"));
  EXPECT_THAT(error(kHead + "element vertex 0\n" + kXyz + "end_header\n"),
              HasSubstr("map.ply: contains no finite vertex"));
  EXPECT_THAT(error_of([] { read_ply("/nowhere.ply"); }), HasSubstr("/nowhere.ply: cannot be opened"));
}

// A count that would exhaust the memory is rejected before reading.
TEST_F(PlyFile, ABinaryFileThatIsCutOff) {
  const std::string head = "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\n" + kXyz + "end_header\n";
  EXPECT_THAT(error(head + std::string(24, '\0')),
              HasSubstr("map.ply: the file is truncated: too short for 2000000000 elements 'vertex'"));
  std::string list = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + kXyz +
                     "element face 1\nproperty list uint int vertex_indices\nend_header\n" + std::string(12, '\0');
  put(list, uint32_t{4000000000}, false);
  EXPECT_THAT(error(list), HasSubstr("the file is truncated in element 'face', number 0 of 1"));
}

}  // namespace
}  // namespace fringeslam

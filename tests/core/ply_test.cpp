// SPDX-License-Identifier: Apache-2.0
// PLY files as written by other systems and by this one.
#include "core/io/ply.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstring>

#include "core/map/surface_mesh.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

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

TEST_F(PlyFile, NumbersBeyondTheRangeOfDoubles) {
  const PlyMap map = read(kHead + "element vertex 3\n" + kXyz + "end_header\n1e400 0 1\n0 -1e999 1\n1e-400 2 1\n");
  EXPECT_EQ(map.dropped, 2u);
  EXPECT_THAT(map.vertices, ElementsAre(Eigen::Vector3d(0, 2, 1)));
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
  EXPECT_THAT(error(two + "end_header\n0 0 0 7\n0 0 1\n"), HasSubstr("map.ply:9: more values than properties"));
  EXPECT_THAT(error(two + "end_header\n0 0\n0 0 0 1\n"), HasSubstr("map.ply:10: more values than properties"));
  EXPECT_THAT(error(two + "end_header\n0 0 0\n0 0 1\n0 1 1\n"),
              HasSubstr("map.ply: values follow the last element; the counts in its header are too small"));
  EXPECT_THAT(error(two + "element face 1\n" + kFaces + "end_header\n0 0 0\n1 0 0\n3 0 1 2\n"),
              HasSubstr("map.ply:13: there are 2 vertices, but a face refers to 2 in element 'face'"));
  EXPECT_THAT(error(two + "element face 1\n" + kFaces + "end_header\n0 0 0\n1 0 0\n3 0 1 nan\n"),
              HasSubstr("map.ply:13: there are 2 vertices, but a face refers to nan in element 'face'"));
  EXPECT_TRUE(read(kHead + "element vertex 0\n" + kXyz + "end_header\n").vertices.empty());
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

SurfaceMesh two_triangles() {
  SurfaceMesh mesh;
  mesh.vertices = {{{1, 2, 3}, {0, 0, -1}, 7, 0.5F},
                   {{-4, 5, 6}, {0, 1, 0}, 255, 0.25F},
                   {{0.1F, -5, 6.5F}, {1, 0, 0}, 0, 0.125F},
                   {{2, 2, 2}, {0.6F, 0.8F, 0}, 9, 0.125F}};
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}};
  return mesh;
}

TEST_F(PlyFile, WrittenFilesAreReadBackExactly) {
  const SurfaceMesh mesh = two_triangles();
  const PlyMap back = read(to_ply(mesh, "world"));
  ASSERT_EQ(back.vertices.size(), 4u);
  ASSERT_EQ(back.normals.size(), 4u);
  ASSERT_EQ(back.colours.size(), 4u);
  ASSERT_EQ(back.sigma_m.size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(back.vertices[i].cast<float>(), mesh.vertices[i].position_m);
    EXPECT_EQ(back.normals[i], mesh.vertices[i].normal);
    EXPECT_THAT(back.colours[i], testing::Each(mesh.vertices[i].grey));
    EXPECT_EQ(back.sigma_m[i], mesh.vertices[i].sigma_m);
  }
  EXPECT_THAT(back.triangles, ElementsAre(Eigen::Vector3i(0, 2, 1), Eigen::Vector3i(1, 2, 3)));
  const PlyMap cloud = read(to_ply(mesh.vertices, "world"));
  EXPECT_EQ(cloud.vertices, back.vertices);
  EXPECT_TRUE(cloud.triangles.empty());
  EXPECT_TRUE(read(to_ply(SurfaceMesh{}, "world")).vertices.empty());
}

TEST_F(PlyFile, PropertiesFollowTheirVertices) {
  const std::string declared = "property float sigma\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";
  const PlyMap map = read(kHead + "element vertex 3\n" + kXyz + declared +
                          "end_header\n0 0 0 0.5 1 2 3\nnan 0 0 0.6 4 5 6\n1 0 0 0.7 7 999 -1\n");
  EXPECT_EQ(map.dropped, 1u);
  EXPECT_THAT(map.sigma_m, ElementsAre(0.5F, 0.7F));
  EXPECT_THAT(map.colours, ElementsAre(ElementsAre(1, 2, 3), ElementsAre(7, 255, 0)));
  EXPECT_TRUE(map.normals.empty());
  // Two elements of vertices, of which only one has a sigma.
  const PlyMap mixed = read(kHead + "element vertex 1\n" + kXyz + "element vertex 1\n" + kXyz +
                            "property float sigma\nend_header\n0 0 0\n1 0 0 0.5\n");
  EXPECT_EQ(mixed.vertices.size(), 2u);
  EXPECT_TRUE(mixed.sigma_m.empty());
}

TEST_F(PlyFile, OwnFilesThatAreDamaged) {
  const std::string bytes = to_ply(two_triangles(), "world");
  EXPECT_THAT(error(bytes.substr(0, bytes.size() - 1)), HasSubstr("map.ply: the file is truncated"));
  std::string wild = bytes;
  wild.replace(wild.size() - 4, 4, "\xff\xff\xff\x7f");
  EXPECT_THAT(error(wild), HasSubstr("there are 4 vertices, but a face refers to 2147483647 in element 'face'"));
  wild = bytes;
  wild.replace(wild.find("vertex 4"), 8, "vertex 999999999999999999");
  EXPECT_THAT(error(wild), HasSubstr("is not a valid element count"));
}

}  // namespace
}  // namespace fringeslam

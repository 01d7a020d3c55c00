// SPDX-License-Identifier: Apache-2.0
// Parts of report.html: decimated maps, their distance from the ground truth, packed numbers, image levels.
#include <gmock/gmock.h>
#include <zlib.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "core/io/ply_writer.h"
#include "core/types/error.h"
#include "sim/scene/scene.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"
#include "tests/tools/child.h"
#include "tools/report/effects.h"
#include "tools/report/map_error.h"
#include "tools/report/packing.h"
#include "tools/report/simplify_mesh.h"
#include "tools/report/view_pictures.h"

namespace fringeslam::tools {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;

const float kNan = std::nanf("");

// Returns a square of n x n vertices, 1 mm apart, on the plane z = 0, facing up.
SurfaceMesh square(uint32_t n) {
  SurfaceMesh mesh;
  for (uint32_t row = 0; row < n; ++row) {
    for (uint32_t col = 0; col < n; ++col)
      mesh.vertices.push_back({{1e-3f * static_cast<float>(col), 1e-3f * static_cast<float>(row), 0},
                               {0, 0, 1},
                               static_cast<uint8_t>(100 + col % 2),
                               1e-4f});
  }
  for (uint32_t row = 0; row + 1 < n; ++row) {
    for (uint32_t col = 0; col + 1 < n; ++col) {
      const uint32_t at = row * n + col;
      mesh.triangles.push_back({at, at + 1, at + n});
      mesh.triangles.push_back({at + 1, at + n + 1, at + n});
    }
  }
  return mesh;
}

double area(const SurfaceMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f u = mesh.vertices[b].position_m - mesh.vertices[a].position_m;
    const Eigen::Vector3f v = mesh.vertices[c].position_m - mesh.vertices[a].position_m;
    sum += 0.5 * (u.x() * v.y() - u.y() * v.x());  // signed: flipped triangles count negatively
  }
  return sum;
}

TEST(SimplifiedMesh, LeavesSmallMeshesAsTheyAre) {
  const SimplifiedMesh thin = thinned(square(10), 100);
  EXPECT_EQ(thin.cell_m, 0);
  EXPECT_EQ(thin.mesh.vertices.size(), 100u);
  EXPECT_EQ(thin.mesh.triangles.size(), 162u);
}

TEST(SimplifiedMesh, KeepsThePlaneItsAreaAndItsSide) {
  const SimplifiedMesh thin = thinned(square(200), 2000);
  EXPECT_LE(thin.mesh.vertices.size(), 2000u);
  EXPECT_GT(thin.mesh.vertices.size(), 900u);
  EXPECT_GT(thin.cell_m, 2e-3);
  for (const CloudPoint& vertex : thin.mesh.vertices) {
    EXPECT_EQ(vertex.position_m.z(), 0);
    EXPECT_THAT(vertex.grey, testing::AnyOf(100, 101));
  }
  const double rim = 2 * 4 * thin.cell_m * 0.2;
  EXPECT_NEAR(area(thin.mesh), 0.199 * 0.199, rim);
}

TEST(SimplifiedMesh, TakesCloudsAndNothing) {
  SurfaceMesh cloud = square(50);
  cloud.triangles.clear();
  EXPECT_LE(thinned(cloud, 100).mesh.vertices.size(), 100u);
  EXPECT_TRUE(thinned(SurfaceMesh{}, 100).mesh.vertices.empty());
}

TEST(SimplifiedMesh, ReadsFilesInPasses) {
  const test::TempFolder temp;
  const SurfaceMesh mesh = square(200);
  PlyWriter file(temp / "mesh.ply", {"world", 0, true, true, 0});
  file.add(mesh.vertices);
  file.add(mesh.triangles);
  file.finish();
  for (const size_t most : {100000u, 2000u}) {
    const SimplifiedMesh of_file = thinned(temp / "mesh.ply", most), of_mesh = thinned(mesh, most);
    EXPECT_EQ(of_file.cell_m, of_mesh.cell_m);
    EXPECT_EQ(of_file.whole_vertices, 40000u);
    EXPECT_EQ(of_file.whole_triangles, mesh.triangles.size());
    EXPECT_EQ(of_file.mesh.triangles, of_mesh.mesh.triangles);
    ASSERT_EQ(of_file.mesh.vertices.size(), of_mesh.mesh.vertices.size());
    for (size_t i = 0; i < of_mesh.mesh.vertices.size(); ++i) {
      EXPECT_EQ(of_file.mesh.vertices[i].position_m, of_mesh.mesh.vertices[i].position_m);
      EXPECT_EQ(of_file.mesh.vertices[i].grey, of_mesh.mesh.vertices[i].grey);
      EXPECT_EQ(of_file.mesh.vertices[i].sigma_m, of_mesh.mesh.vertices[i].sigma_m);
    }
  }
  test::write_bytes(temp / "other.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n");
  EXPECT_THAT(support::error_of([&] { thinned(temp / "other.ply", 10); }),
              HasSubstr("other.ply: is not a map written by fringeslam run"));
  const std::string whole = test::read_bytes(temp / "mesh.ply");
  test::write_bytes(temp / "cut.ply", whole.substr(0, whole.size() - 1));
  EXPECT_THAT(support::error_of([&] { thinned(temp / "cut.ply", 100); }), HasSubstr("cut.ply: the file is truncated"));
}

TEST(Packing, IsBase64) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64(std::string("\xff\x00\xfe", 3)), "/wD+");
}

TEST(Packing, DifferencesWrapAround) {
  EXPECT_EQ(difference_bytes(std::vector<uint16_t>{3, 2, 260}), std::string("\x03\x00\xff\xff\x02\x01", 6));
}

TEST(Packing, Inflates) {
  const std::string text(5000, 'x');
  const std::string small = deflated(text);
  EXPECT_LT(small.size(), 100u);
  std::string back(text.size(), '\0');
  uLongf size = back.size();
  ASSERT_EQ(uncompress(reinterpret_cast<Bytef*>(back.data()), &size, reinterpret_cast<const Bytef*>(small.data()),
                       small.size()),
            Z_OK);
  EXPECT_EQ(back, text);
}

// A camera 1 m above the plane z = 0 looks down at it; the points have known distances from that plane.
class MapErrors : public testing::Test {
 protected:
  MapErrors() : rig_(test::thesis_rig_reduced(5)) {
    const Pinhole& camera = rig_.camera;
    truth_.depth_m = cv::Mat1f(camera.height, camera.width, 1.0f);
    truth_.normals = cv::Mat3f(camera.height, camera.width, cv::Vec3f(0, 0, -1));
    truth_.mask = cv::Mat1f(camera.height, camera.width, static_cast<float>(kTruthSurface | kTruthInBeam));
    map_from_camera_ = pose_from({{0, 0, 1000}, {180, 0, 0}});
  }
  CloudPoint point(float x, float z, const Eigen::Vector3f& normal = {0, 0, 1}) const {
    return {{x, 0, z}, normal, 0, 0};
  }
  std::vector<float> errors(const std::vector<CloudPoint>& points) const {
    MapError error(points, rig_);
    error.add(truth_, map_from_camera_);
    return error.distances_m();
  }

  RigModel rig_;
  TruthFrame truth_;
  Pose map_from_camera_;
};

TEST_F(MapErrors, AreSignedDistancesFromThePlane) {
  const std::vector<float> found = errors({point(0, 0), point(0.05f, 1e-3f), point(-0.05f, -2e-3f)});
  EXPECT_NEAR(found[0], 0, 1e-7);
  EXPECT_NEAR(found[1], -1e-3, 1e-6);  // too near
  EXPECT_NEAR(found[2], 2e-3, 1e-6);
}

TEST_F(MapErrors, AreUnknownOutOfSight) {
  const float far_away = 0.5f;  // the image is 0.26 m wide
  for (const float error : errors({point(far_away, 0), point(0, 2), point(0, 0.04f), point(0, 0, {1, 0, 0})}))
    EXPECT_TRUE(std::isnan(error));
  truth_.mask.setTo(kTruthMixed);
  EXPECT_TRUE(std::isnan(errors({point(0, 0)})[0]));
  truth_.depth_m.setTo(kNan);
  truth_.mask.setTo(0);
  EXPECT_TRUE(std::isnan(errors({point(0, 0)})[0]));
}

TEST(Levels, SpanTheirRangeAndKeepZeroForNothing) {
  const cv::Mat1b found = levels((cv::Mat1f(1, 6) << kNan, -9, -1, 0, 1, 9), -1, 1);
  EXPECT_THAT(std::vector<uchar>(found.begin(), found.end()), ElementsAre(0, 1, 1, 128, 255, 255));
}

TEST(ErrorLimit, IsRoundAndFromTheMedian) {
  EXPECT_THAT(error_limit_m({1e-4f, -1e-4f, 2, kNan}), DoubleNear(5e-4, 1e-9));
  EXPECT_THAT(error_limit_m({2.5e-4f}), DoubleNear(1e-3, 1e-9));
  EXPECT_EQ(error_limit_m({kNan}), 0);
}

TEST(Pictures, StayWithinTheirBytes) {
  cv::RNG random(1);
  std::vector<ViewImages> views;
  for (int i = 0; i < 8; ++i) {
    ViewImages view{i, cv::Mat1b(300, 320), cv::Mat1f(300, 320), cv::Mat1f(300, 320)};
    random.fill(view.texture, cv::RNG::UNIFORM, 0, 255);
    random.fill(view.depth_m, cv::RNG::UNIFORM, 0.7, 1.4);
    random.fill(view.error_m, cv::RNG::NORMAL, 0, 1e-4);
    views.push_back(view);
  }
  const auto size = [&](size_t limit) {
    size_t sum = 0;
    for (const auto& pictures : encoded(views, picture_scales(views), limit)) sum += pictures.dump().size();
    return sum;
  };
  const size_t whole = size(100'000'000);
  EXPECT_GT(whole, 1'000'000u);
  EXPECT_LT(size(whole / 4), 0.3 * static_cast<double>(whole));
}

// Collects the names of the effects in their order.
struct EffectNames {
  std::vector<std::string> names;
  void field(const char* name, bool&, const char*) { names.emplace_back(name); }
  void field(const char*, int&, Range, const char*) {}
};

TEST(EffectsPicture, ShowsEachEffectAlone) {
  const test::TempFolder temp;
  test::write_small_scene(temp.path());
  sim::RenderOptions options;
  options.samples_per_pixel = 1;
  options.noise = false;
  const cv::Mat3b picture = effects_picture(sim::load_scene(temp / "scene.yaml"), options);
  EffectNames effects;
  options.effects.describe(effects);
  constexpr int kColumns = 5, kGap = 8, kTitle = 26;
  const cv::Size cell(384, 360);
  const auto panel = [&](size_t i) {
    const int row = static_cast<int>(i) / kColumns, column = static_cast<int>(i) % kColumns;
    return picture(
        cv::Rect({kGap + column * (cell.width + kGap), kGap + kTitle + row * (cell.height + kTitle + kGap)}, cell));
  };
  const cv::Mat3b none = panel(0);
  std::vector<std::string> visible;
  for (size_t i = 0; i < effects.names.size(); ++i) {
    if (cv::norm(panel(i + 1), none, cv::NORM_L1) > 0) visible.push_back(effects.names[i]);
  }
  // The scene has opaque and matte surfaces in clear air, a pinhole camera and no bounces of light.
  EXPECT_THAT(visible, ElementsAre("vignetting", "defocus", "pixel_gap", "lens_blur", "fixed_pattern"));
  EXPECT_GT(cv::norm(panel(effects.names.size() + 1), none, cv::NORM_L1), 0);
}

TEST(EffectsPicture, OfAPathThatIsTooShortIsRefused) {
  const test::TempFolder temp;
  test::write_small_scene(temp.path());
  sim::SceneLoadOptions reading;
  reading.changes = {{"trajectory", "{poses: [{}, {translation_m: [0.001, 0, 0]}], continuous: {speed_m_s: 1}}"}};
  const sim::Scene scene = sim::load_scene(temp / "scene.yaml", reading);
  EXPECT_THAT(support::error_of([&] { effects_picture(scene, {}); }),
              HasSubstr("the path is shorter than one stack of 9 images"));
}

}  // namespace
}  // namespace fringeslam::tools

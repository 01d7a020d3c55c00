// SPDX-License-Identifier: Apache-2.0
// Compares the predicted depth sigma with the scatter over many noisy renderings of a board: decoding and triangulation
// must neither under- nor overestimate their uncertainty, for any modulation, slope and range.
#include <gmock/gmock.h>

#include <cmath>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

struct Board {
  double range_m, slope_deg, albedo;
};
void PrintTo(const Board& board, std::ostream* out) {
  *out << board.range_m << " m, " << board.slope_deg << " degrees, albedo " << board.albedo;
}

Scene scene_of(const Board& board) {
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/flat_board/scene.yaml");
  crop(scene.rig.camera, 24);
  scene.objects[0].material.albedo = board.albedo;
  scene.objects[0].world_from_object =
      pose_from({{0, 0, 1e3 * board.range_m}, {0.6 * board.slope_deg, board.slope_deg, 0}});
  return scene;
}

class HonestSigma : public testing::TestWithParam<Board> {};
INSTANTIATE_TEST_SUITE_P(Boards, HonestSigma,
                         testing::Values(Board{0.75, 0, 0.5}, Board{0.75, 55, 0.3}, Board{1, 0, 0.8},
                                         Board{1, 30, 0.25}, Board{1, 55, 0.5}, Board{1.35, 0, 0.2},
                                         Board{1.35, 30, 0.8}, Board{1.35, 55, 0.5}));

TEST_P(HonestSigma, IsTheScatterOverSeeds) {
  constexpr int kSeeds = 60;
  Scene scene = scene_of(GetParam());
  const Triangulation triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5);
  cv::Mat1d sum, squares, variance;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    scene.seed = static_cast<uint64_t>(seed);
    const auto stack = VirtualRig(scene, {}).capture(scene.patterns);
    Frame frame;
    triangulate(frame, decode(*stack, scene.rig, {}), triangulation, {});
    if (sum.empty()) {
      for (cv::Mat1d* image : {&sum, &squares, &variance}) *image = cv::Mat1d::zeros(frame.points_m.size());
    }
    // The NaN of a seed without depth propagates and excludes the pixel.
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        const double z = static_cast<double>(frame.points_m(row, col)[2]) - GetParam().range_m;
        sum(row, col) += z;
        squares(row, col) += z * z;
        variance(row, col) += std::pow(static_cast<double>(frame.sigma_m(row, col)), 2);
      }
    }
  }
  double ratios = 0;
  int pixels = 0;
  for (int row = 0; row < sum.rows; ++row) {
    for (int col = 0; col < sum.cols; ++col) {
      const double scatter = (squares(row, col) - sum(row, col) * sum(row, col) / kSeeds) / (kSeeds - 1);
      const double ratio = scatter / (variance(row, col) / kSeeds);
      if (std::isnan(ratio)) continue;
      ratios += ratio;
      ++pixels;
    }
  }
  ASSERT_GT(pixels, 300);
  EXPECT_GT(std::sqrt(ratios / pixels), 0.9);
  EXPECT_LT(std::sqrt(ratios / pixels), 1.1);
}

}  // namespace
}  // namespace fringeslam::sim

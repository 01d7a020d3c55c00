// SPDX-License-Identifier: Apache-2.0
// Gray codes in a groove of white walls: light that bounces between them reverses bits with wide stripes, and hardly
// differs between the stripes of bits that are combined with a fine one.
#include <gmock/gmock.h>

#include <cmath>

#include "core/decode/decode.h"
#include "sim/virtual_rig.h"

namespace fringeslam::sim {
namespace {

struct Shares {
  double decoded = 0, wrong = 0;  // of the lit pixels; of the decoded ones
};

Shares in_groove(double xor_px) {
  SceneLoadOptions reading;
  reading.changes = {{"patterns.periods_px", "[16]"}, {"patterns.steps", "4"}, {"patterns.gray", "complementary"}};
  if (xor_px > 0) reading.changes.emplace_back("patterns.gray_xor_px", std::to_string(xor_px));
  const Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/groove_60/scene.yaml", reading);
  const auto view = VirtualRig(scene, {}).simulate(scene.patterns);
  const cv::Mat1f found = decode(view->stack, scene.rig, {}).coordinate_px, &truth = view->truth.projector_column;
  int lit = 0, decoded = 0, wrong = 0;
  for (int row = 0; row < truth.rows; ++row) {
    for (int col = 0; col < truth.cols; ++col) {
      if (!is_lit_surface(static_cast<int>(view->truth.mask(row, col)))) continue;
      ++lit;
      if (std::isnan(found(row, col))) continue;
      ++decoded;
      wrong += std::abs(found(row, col) - truth(row, col)) > 8;
    }
  }
  return {static_cast<double>(decoded) / lit, static_cast<double>(wrong) / decoded};
}

TEST(GrayXor, DecodesWhereLightBounces) {
  const Shares plain = in_groove(0);
  for (const double xor_px : {16.0, 32.0}) {
    const Shares combined = in_groove(xor_px);
    EXPECT_GT(combined.decoded, 0.97) << xor_px;
    EXPECT_LT(combined.wrong, 1e-3) << xor_px;
    EXPECT_LT(plain.decoded, combined.decoded - 0.2) << xor_px;
  }
  EXPECT_LT(plain.wrong, 1e-3) << "uncertain bits must be dropped";
}

}  // namespace
}  // namespace fringeslam::sim

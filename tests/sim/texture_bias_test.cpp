// SPDX-License-Identifier: Apache-2.0
// The bias of points beside texture, or where the lens transmits less and less light, is the one that docs/method.md, section 4.1,
// derives from pixel, lens blur and defocus, and depth.texture_correction subtracts it.
#include <gmock/gmock.h>

#include <cmath>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

struct Lens {
  double blur_px, f_number, focus_m;
};
void PrintTo(const Lens& lens, std::ostream* out) {
  *out << lens.blur_px << " px, f/" << lens.f_number << " in focus at " << lens.focus_m << " m";
}

class TextureBias : public testing::TestWithParam<Lens> {};
INSTANTIATE_TEST_SUITE_P(Lenses, TextureBias,
                         testing::Values(Lens{0, 16, 1}, Lens{0.3, 16, 1}, Lens{0.7, 16, 1}, Lens{0.3, 2, 1.1}));

struct Errors {
  double slope = 0;                                 // of the uncorrected errors over the biases: 1 if they agree
  double uncorrected_m = 0, corrected_m = 0;        // root mean square
  double uncorrected_turn = 0, corrected_turn = 0;  // growth of the errors along the rows, m/px
};

Errors errors(const Frame& uncorrected, const Frame& corrected, const TruthFrame& truth) {
  double products = 0, squares = 0, before = 0, after = 0, turn_before = 0, turn_after = 0, moment = 0;
  int pixels = 0;
  for (int row = 2; row + 2 < uncorrected.height(); ++row) {
    for (int col = 2; col + 2 < uncorrected.width(); ++col) {
      const double z = uncorrected.points_m(row, col)[2], better = corrected.points_m(row, col)[2],
                   depth = truth.depth_m(row, col);
      if (std::isnan(z + better + depth)) continue;
      products += (z - depth) * (z - better), squares += (z - better) * (z - better);
      before += (z - depth) * (z - depth), after += (better - depth) * (better - depth);
      const double x = col - 0.5 * (uncorrected.width() - 1);
      turn_before += x * (z - depth), turn_after += x * (better - depth), moment += x * x;
      ++pixels;
    }
  }
  return {products / squares, std::sqrt(before / pixels), std::sqrt(after / pixels), turn_before / moment,
          turn_after / moment};
}

Scene board(const Lens& lens) {
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/flat_board/scene.yaml");
  crop(scene.rig.camera, 160);
  scene.rig.camera_lens.blur_px = lens.blur_px;
  scene.rig.camera_lens.f_number = lens.f_number;
  scene.rig.camera_lens.focus_m = lens.focus_m;
  scene.rig.projector_lens.flux_lm *= std::pow(lens.f_number / 12, 2);  // as bright as with the rig's f/12
  scene.objects[0].world_from_object = pose_from({{0, 0, 950}, {10, 25, 20}});
  return scene;
}

Errors errors_of(const Scene& scene) {
  const auto view = VirtualRig(scene, {36, false, false}).simulate(scene.patterns);
  const DecodedStack decoded = decode(view->stack, scene.rig, {});
  DepthOptions on, off;
  on.texture_correction = true, off.texture_correction = false;
  const PixelRays rays = pixel_rays(scene.rig.camera);
  return errors(reconstruct(decoded, scene.rig, rays, off), reconstruct(decoded, scene.rig, rays, on), view->truth);
}

TEST_P(TextureBias, IsThatOfThePointSpread) {
  Scene scene = board(GetParam());
  Material& material = scene.objects[0].material;
  material.grain = Grain::wood, material.albedo = 0.5, material.contrast = 0.35, material.grain_m = 0.01;
  const Errors found = errors_of(scene);
  EXPECT_NEAR(found.slope, 1, 0.1);
  EXPECT_LT(found.corrected_m, 0.7 * found.uncorrected_m);
}

// Unlike texture, vignetting biases neighboring pixels alike, which turns the whole view. It belongs to places on the image, so that
// defocus, which mixes light from several directions there, does not add to it.
TEST_P(TextureBias, OfVignettingIsThatOfThePointSpread) {
  if (GetParam().f_number < 16) GTEST_SKIP() << "out of focus";
  Scene scene = board(GetParam());
  scene.rig.camera_lens.vignetting = 1500;  // falls to a ninth in the corners of this narrow field
  scene.rig.camera.cx = scene.rig.camera.cy = 80;
  Material& material = scene.objects[0].material;
  material.grain = Grain::plain, material.albedo = 0.5;
  const Errors found = errors_of(scene);
  EXPECT_GT(std::abs(found.uncorrected_turn), 2e-8);
  EXPECT_LT(std::abs(found.corrected_turn), 0.05 * std::abs(found.uncorrected_turn));
}

}  // namespace
}  // namespace fringeslam::sim

// SPDX-License-Identifier: Apache-2.0
// The bias of points beside texture is the one that docs/method.md, section 4.1, derives from pixel, lens blur and defocus, and
// depth.texture_correction subtracts it.
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
  double slope = 0;                           // of the uncorrected errors over the biases: 1 if they agree
  double uncorrected_m = 0, corrected_m = 0;  // root mean square
};

Errors errors(const Frame& uncorrected, const Frame& corrected, const TruthFrame& truth) {
  double products = 0, squares = 0, before = 0, after = 0;
  int pixels = 0;
  for (int row = 2; row + 2 < uncorrected.height(); ++row) {
    for (int col = 2; col + 2 < uncorrected.width(); ++col) {
      const double z = uncorrected.points_m(row, col)[2], better = corrected.points_m(row, col)[2],
                   depth = truth.depth_m(row, col);
      if (std::isnan(z + better + depth)) continue;
      products += (z - depth) * (z - better), squares += (z - better) * (z - better);
      before += (z - depth) * (z - depth), after += (better - depth) * (better - depth);
      ++pixels;
    }
  }
  return {products / squares, std::sqrt(before / pixels), std::sqrt(after / pixels)};
}

TEST_P(TextureBias, IsThatOfThePointSpread) {
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/flat_board/scene.yaml");
  crop(scene.rig.camera, 160);
  scene.rig.camera_lens.blur_px = GetParam().blur_px;
  scene.rig.camera_lens.f_number = GetParam().f_number;
  scene.rig.camera_lens.focus_m = GetParam().focus_m;
  scene.rig.projector_lens.flux_lm *= std::pow(GetParam().f_number / 12, 2);  // as bright as with the rig's f/12
  Material& material = scene.objects[0].material;
  material.grain = Grain::wood, material.albedo = 0.5, material.contrast = 0.35, material.grain_m = 0.01;
  scene.objects[0].world_from_object = pose_from({{0, 0, 950}, {10, 25, 20}});
  const auto view = VirtualRig(scene, {16, false, false}).simulate(scene.patterns);
  const DecodedStack decoded = decode(view->stack, scene.rig, {});
  DepthOptions on;
  on.texture_correction = true;
  const PixelRays rays = pixel_rays(scene.rig.camera);
  const Frame uncorrected = reconstruct(decoded, scene.rig, rays, {}),
              corrected = reconstruct(decoded, scene.rig, rays, on);
  const Errors found = errors(uncorrected, corrected, view->truth);
  EXPECT_NEAR(found.slope, 1, 0.1);
  EXPECT_LT(found.corrected_m, 0.7 * found.uncorrected_m);
}

}  // namespace
}  // namespace fringeslam::sim

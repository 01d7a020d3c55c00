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

// Slope of errors over predicted biases: 1 if they are the errors, 0 if they are unrelated.
double slope(const Frame& frame, const Frame& uncorrected, const Frame& corrected, const TruthFrame& truth) {
  double products = 0, squares = 0;
  for (int row = 2; row + 2 < frame.height(); ++row) {
    for (int col = 2; col + 2 < frame.width(); ++col) {
      const auto z = [&](const Frame& of) { return static_cast<double>(of.points_m(row, col)[2]); };
      const double bias = z(uncorrected) - z(corrected),
                   error = z(frame) - static_cast<double>(truth.depth_m(row, col));
      if (std::isnan(bias + error)) continue;
      products += error * bias, squares += bias * bias;
    }
  }
  return products / squares;
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
  DepthOptions off;
  off.texture_correction = false;
  const PixelRays rays = pixel_rays(scene.rig.camera);
  const Frame uncorrected = reconstruct(decoded, scene.rig, rays, off),
              corrected = reconstruct(decoded, scene.rig, rays, {});
  EXPECT_NEAR(slope(uncorrected, uncorrected, corrected, view->truth), 1, 0.1);
  EXPECT_NEAR(slope(corrected, uncorrected, corrected, view->truth), 0, 0.1);
}

}  // namespace
}  // namespace fringeslam::sim

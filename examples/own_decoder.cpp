// SPDX-License-Identifier: Apache-2.0
// Plugs another decoder into the mapper: own_decoder SCENE.yaml. This is a textbook decoder: three-step phase shifting,
// unwrapped from the coarsest period to the finest. It assumes 8-bit images; three steps of -120, 0 and 120 degrees per
// period; only column fringes, ordered from coarse to fine; a coarsest period that covers the projector; and a camera at
// rest during each stack. It checks none of this.
#include <fringeslam/fringeslam.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

using namespace fringeslam;

class TextbookDecoder : public FrontEnd {
 public:
  explicit TextbookDecoder(const RigModel& rig) : rig_(rig), rays_(pixel_rays(rig.camera)) {}

  ReconstructedView reconstruct(const FringeStack& stack, const ReconstructionPrior&) const override {
    const int height = rig_.camera.height, width = rig_.camera.width;
    const float nan = std::nanf("");
    DecodedStack decoded;
    decoded.index = stack.index;
    decoded.timestamp_s = stack.timestamp_s;
    decoded.full_scale_dn = rig_.sensor.max_dn();
    decoded.mean = cv::Mat1f(height, width, 0.f);
    decoded.coordinate_px = cv::Mat1f(height, width, nan);
    decoded.sigma_px = cv::Mat1f(height, width, nan);
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) decode_pixel(stack, row, col, decoded);
    }
    return {fringeslam::reconstruct(decoded, rig_, rays_, DepthOptions{}), decoded, true};
  }

 private:
  void decode_pixel(const FringeStack& stack, int row, int col, DecodedStack& decoded) const {
    double column = std::nan("");  // of the projector, from the periods so far
    for (size_t first = 0; first + 2 < stack.images.size(); first += 3) {
      const auto grey = [&](size_t k) { return static_cast<double>(stack.images[first + k].at<uchar>(row, col)); };
      const double sine = std::numbers::sqrt3 * (grey(0) - grey(2)), cosine = 2 * grey(1) - grey(0) - grey(2);
      const double modulation = std::hypot(sine, cosine) / 3, mean = (grey(0) + grey(1) + grey(2)) / 3;
      if (modulation < 4 || std::max({grey(0), grey(1), grey(2)}) > 250) return;
      const double period = stack.patterns.patterns[first].period_px;
      double phase = std::atan2(sine, cosine);
      if (phase < 0) phase += 2 * std::numbers::pi;
      const double fraction = phase * period / (2 * std::numbers::pi) - 0.5;  // integer columns are pixel centres
      column = std::isnan(column) ? fraction : fraction + period * std::round((column - fraction) / period);
      const double noise_dn = std::sqrt(rig_.sensor.variance_dn2(mean));
      decoded.mean(row, col) = static_cast<float>(mean);
      decoded.sigma_px(row, col) =
          static_cast<float>(std::sqrt(2.0 / 3) * noise_dn / modulation * period / (2 * std::numbers::pi));
    }
    decoded.coordinate_px(row, col) = static_cast<float>(column);
  }

  RigModel rig_;
  PixelRays rays_;
};

int main(int argc, char** argv) {
  const sim::Scene scene = sim::load_scene(argc > 1 ? argv[1] : "scenes/boxes_and_foam/scene.yaml");
  sim::VirtualRig rig(scene, {});
  const PipelineOptions options;
  Pipeline pipeline(std::make_shared<TextbookDecoder>(rig.model()),
                    Mapper(rig.model(), options.mapper(), scene.trajectory.front().world_from_robot), scene.patterns,
                    options);
  Driver(rig, pipeline).run([](const MappedView& view) {
    std::printf("view %d: %s\n", view.stack.index, to_string(view.result.tracking).c_str());
  });
  const TrajectoryScore score = score_trajectory(pipeline.trajectory(), scene.trajectory);
  std::printf("%d poses, ATE %.4f mm\n", score.poses, 1e3 * score.ate_rmse_m);
  return score.poses == static_cast<int>(scene.trajectory.size()) && score.ate_rmse_m < 1e-3 ? 0 : 1;
}

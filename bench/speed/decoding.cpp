// SPDX-License-Identifier: Apache-2.0
// Decoding compared with OpenCV's; the two are interleaved, so that other load on the machine affects both alike.
#include <algorithm>
#include <cstdio>
#include <opencv2/structured_light.hpp>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/base/parallel.h"
#include "core/decode/decode.h"
#include "core/decode/spatial.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// Three images of fine fringes on a scene of steps and holes, 532 x 500, and the coordinates that a map would predict.
struct ThreeImages {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/steps_and_holes/scene.yaml");
  PatternSequence sequence =
      phase_shift_sequence(scene.rig.projector.width, scene.rig.projector.height, {16.5}, 3, Axis::columns, 8);
  PixelRays rays = pixel_rays(scene.rig.camera);
  Triangulation triangulation{scene.rig, rays, 0.4, 2.5};
  FringeStack stack;
  CoordinatePrior expected;
  DecodeOptions options;
  DecodedStack decoded;
  Frame frame;

  ThreeImages() {
    const auto view = sim::VirtualRig(scene, {}).simulate(sequence);
    stack = view->stack;
    expected = predict_coordinate(scene.rig, rays, view->truth.depth_m, cv::Mat1f(rays.size(), 1e-3f));
    options.unwrapping = Unwrapping::predicted;
    decode();
  }
  void decode() { decode_into(decoded, stack, scene.rig, options, {Axis::columns, &expected}); }
};

// OpenCV's three-step profilometry: wrapped phase, then spatial unwrapping by reliability.
class OpenCvPsp {
 public:
  explicit OpenCvPsp(const ThreeImages& images) : images_(images.stack.images.begin(), images.stack.images.end()) {
    const auto params = cv::makePtr<cv::structured_light::SinusoidalPattern::Params>();
    params->width = images.sequence.width;
    params->height = images.sequence.height;
    params->nbrOfPeriods = 62;
    params->setMarkers = false;
    params->horizontal = false;
    params->methodId = cv::structured_light::PSP;
    pattern_ = cv::structured_light::SinusoidalPattern::create(params);
  }
  void operator()() {
    pattern_->computePhaseMap(images_, wrapped_, shadow_);
    pattern_->unwrapPhaseMap(wrapped_, unwrapped_, images_[0].size(), shadow_);
  }

 private:
  std::vector<cv::Mat> images_;
  cv::Ptr<cv::structured_light::SinusoidalPattern> pattern_;
  cv::Mat wrapped_, shadow_, unwrapped_;
};

std::vector<Row> decode_rows(const Context& context) {
  ThreeImages ours;
  OpenCvPsp psp(ours);
  const auto times = interleaved_times({[&] { psp(); }, [&] { ours.decode(); }}, context.quick ? 5 : 25);
  const Row theirs = median_row("", in_ms(times[0]), "ms", 0), own = median_row("", in_ms(times[1]), "ms", 0);
  std::fprintf(stderr, "  OpenCV PSP %.0f ms, ours with absolute phase and sigma %.2f ms\n", theirs.value, own.value);
  return {median_row("speed.decode", ratios(times[0], times[1]), "x", 100, Limit::least)};
}

// Bytes per pixel that must be read and written: grey values, predicted coordinates, decoded images, point polynomials.
constexpr double kBytesPerPixel =
    3 + 3 * 4 + 7 * 4 /* decoded */ + 2 * 4 + 8 * 4 + 2 * 4 /* read again */ + 1 + 3 * 4 + 4;

std::vector<Row> points_rows(const Context& context) {
  ThreeImages ours;
  const auto pixels = static_cast<double>(ours.rays.total());
  const auto bytes = static_cast<size_t>(kBytesPerPixel * pixels / 2);  // a copy reads and writes
  std::vector<char> source(bytes, 1), target(bytes, 0);
  const auto work = [&] {
    ours.decode();
    triangulate(ours.frame, ours.decoded, ours.triangulation, {});
  };
  const auto copy = [&] {
    for_each_row(16, [&](int i) {
      const size_t part = bytes / 16;
      std::copy_n(source.data() + part * static_cast<size_t>(i), part, target.data() + part * static_cast<size_t>(i));
    });
  };
  const auto times = interleaved_times({work, copy}, context.quick ? 20 : 200);
  const Row row = median_row("speed.points", in_ms(times[0]), "ms", 3);
  const Row copied = median_row("", in_ms(times[1]), "ms", 0);
  std::fprintf(stderr, "  %.0f bytes per pixel: a memory copy of as many takes %.2f ms, %.0f %% of ours\n",
               kBytesPerPixel, copied.value, 100 * copied.value / row.value);
  return {row};
}

std::vector<Row> micro_rows(const Context& context) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/bowl/scene.yaml");
  const FringeStack stack = *sim::VirtualRig(scene, {}).capture(scene.patterns);
  DecodedStack decoded;
  const auto times = interleaved_times({[&] { decode_into(decoded, stack, scene.rig, {}); }}, context.quick ? 10 : 100);
  return {median_row("speed.decode.micro", in_ms(times[0]), "ms", 15)};
}

std::vector<Row> spatial_rows(const Context& context) {
  ThreeImages ours;
  const auto times =
      interleaved_times({[&] { unwrap_by_quality(ours.decoded.wrapped_phase, ours.decoded.sigma_px, 1.6); },
                         [&] { unwrap_by_reliability(ours.decoded.wrapped_phase, 1.6); }},
                        context.quick ? 10 : 60);
  const Row reliability = median_row("", in_ms(times[1]), "ms", 0);
  std::fprintf(stderr, "  by reliability: %.1f ms\n", reliability.value);
  return {median_row("speed.spatial", in_ms(times[0]), "ms", 10)};
}

}  // namespace

std::vector<Item> decoding_items() {
  return {{{"speed.decode"},
           "three images to absolute phase, against OpenCV's SinusoidalPattern (PSP); fringe orders come from the "
           "predicted view, whose cost (speed.expected_view) is not included",
           decode_rows},
          {{"speed.points"},
           "three images to points with sigma; fringe orders come from the predicted view, whose cost "
           "(speed.expected_view) is not included",
           points_rows},
          {{"speed.decode.micro"}, "seven images of micro phase shifting to coordinate and sigma", micro_rows},
          {{"speed.spatial"}, "quality-guided spatial unwrapping, 532 x 500", spatial_rows}};
}

}  // namespace fringeslam::bench

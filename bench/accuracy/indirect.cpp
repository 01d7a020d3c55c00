// SPDX-License-Identifier: Apache-2.0
// Depth where light bounces between white surfaces: grooves, a bowl and a corner. Micro phase shifting against the usual
// nine images of three periods, of which the long ones see the indirect light as fringes of their own. By default, our
// decoder rejects most of these pixels, because the periods contradict each other; the comparison is with all of them.
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "bench/row.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/patterns/design.h"
#include "core/score/score.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

constexpr int kBouncePaths = 16;      // few paths leave fringes in the indirect light that are not there
constexpr double kAnyResidual = 1e6;  // the usual decoder keeps pixels whose periods disagree

constexpr const char* kConcave[] = {"groove_90", "groove_60", "bowl", "corner"};

PatternSequence nine_images(const RigModel& rig) {
  SequenceDesign design{rig.projector.width, rig.projector.height};
  design.periods_px = {1040, 131, 16.5};
  return design_sequence(design);
}

// Three periods of about 16 px, whose beats number the fringes.
PatternSequence heterodyne(const RigModel& rig) {
  SequenceDesign design{rig.projector.width, rig.projector.height};
  design.periods_px = {128 / 7.0, 16.25, 16};
  return design_sequence(design);
}

// Four steps of 16 px, numbered by a Gray code whose bits XOR combines to stripes of 16 px.
PatternSequence gray_xor(const RigModel& rig) {
  SequenceDesign design{rig.projector.width, rig.projector.height};
  design.periods_px = {16};
  design.steps = 4;
  design.gray = GrayCode::complementary;
  design.gray_xor_px = {16};
  return design_sequence(design);
}

double share(int part, int all) { return static_cast<double>(part) / std::max(1, all); }

// Errors of one scene, summed over the seeds.
struct Errors {
  cv::Mat1d sum, count;
  int compared = 0, wrong_order = 0, dishonest = 0, lit = 0;

  void add(const DecodedStack& decoded, const Frame& frame, const TruthFrame& truth) {
    constexpr float kSigmas = 4;
    if (sum.empty()) {
      sum = cv::Mat1d::zeros(truth.depth_m.size());
      count = cv::Mat1d::zeros(truth.depth_m.size());
    }
    const auto half_period = static_cast<float>(0.5 * decoded.finest_period_px);
    for (int row = 0; row < sum.rows; ++row) {
      for (int col = 0; col < sum.cols; ++col) {
        if (!is_lit_surface(static_cast<int>(truth.mask(row, col)))) continue;
        ++lit;
        const float error = frame.points_m(row, col)[2] - truth.depth_m(row, col);
        if (std::isnan(error)) continue;
        ++compared;
        dishonest += std::abs(error) > kSigmas * frame.sigma_m(row, col);
        wrong_order += std::abs(decoded.coordinate_px(row, col) - truth.projector_column(row, col)) > half_period;
        sum(row, col) += static_cast<double>(error);
        ++count(row, col);
      }
    }
  }

  // Mean over the pixels of the absolute value of the mean error over the seeds.
  double bias_m(int seeds) const {
    double total = 0;
    int pixels = 0;
    for (int i = 0; i < static_cast<int>(sum.total()); ++i) {
      if (2 * count(i / sum.cols, i % sum.cols) < seeds) continue;
      total += std::abs(sum(i / sum.cols, i % sum.cols) / count(i / sum.cols, i % sum.cols));
      ++pixels;
    }
    return pixels > 0 ? total / pixels : NAN;
  }
};

// `patterns` of a rig; null: the scene's own.
using Patterns = PatternSequence (*)(const RigModel& rig);

Errors errors_of(const std::string& name, int seeds, Patterns patterns, const DecodeOptions& options, size_t& images) {
  Errors errors;
  for (int seed = 1; seed <= seeds; ++seed) {
    const sim::Scene scene =
        sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", {static_cast<uint64_t>(seed)});
    sim::RenderOptions rendering;
    rendering.effects.bounce_paths = kBouncePaths;
    const auto view = sim::VirtualRig(scene, rendering).simulate(patterns ? patterns(scene.rig) : scene.patterns);
    images = view->stack.images.size();
    const DecodedStack decoded = decode(view->stack, scene.rig, options);
    const Frame frame = reconstruct(decoded, scene.rig, pixel_rays(scene.rig.camera), {});
    errors.add(decoded, frame, view->truth);
  }
  return errors;
}

std::vector<Row> indirect_rows(const Context& context) {
  const int seeds = context.quick ? 3 : 20;
  double all_before_m = 0, all_after_m = 0;
  double worst_wrong = 0, worst_dishonest = 0, least_valid = 1;
  size_t images = 0;
  DecodeOptions all_kept;
  all_kept.max_order_residual_sigma = kAnyResidual;
  for (const char* name : kConcave) {
    size_t usual_images = 0;
    const Errors usual = errors_of(name, seeds, nine_images, all_kept, usual_images),
                 micro = errors_of(name, seeds, nullptr, {}, images);
    const double before_m = usual.bias_m(seeds), after_m = micro.bias_m(seeds);
    std::fprintf(stderr,
                 "  %-9s: bias %.4f mm with %zu images, %.4f mm with %zu of micro phase shifting; wrong orders %.1e, "
                 "%.1e; beyond 4 sigmas %.1e, %.1e; pixels with depth %.3f, %.3f\n",
                 name, 1e3 * before_m, usual_images, 1e3 * after_m, images, share(usual.wrong_order, usual.compared),
                 share(micro.wrong_order, micro.compared), share(usual.dishonest, usual.compared),
                 share(micro.dishonest, micro.compared), share(usual.compared, usual.lit),
                 share(micro.compared, micro.lit));
    all_before_m += before_m;
    all_after_m += after_m;
    worst_wrong = std::max(worst_wrong, share(micro.wrong_order, micro.compared));
    worst_dishonest = std::max(worst_dishonest, share(micro.dishonest, micro.compared));
    least_valid = std::min(least_valid, share(micro.compared, micro.lit));
  }
  const int n = seeds * static_cast<int>(std::size(kConcave));
  return {bound_row("indirect.bias", all_after_m / all_before_m, n, "x", 0.1, Limit::most),
          bound_row("indirect.wrong_order", worst_wrong, n, "share", 1e-3, Limit::most),
          bound_row("indirect.honest", worst_dishonest, n, "share", 1e-3, Limit::most),
          bound_row("indirect.valid", least_valid, n, "share", 0.98, Limit::least),
          bound_row("indirect.images", static_cast<double>(images), n, "images", 12, Limit::most)};
}

std::vector<Row> other_rows(const Context& context) {
  const int seeds = context.quick ? 1 : 5;
  double worst_wrong = 0, worst_dishonest = 0, least_valid = 1;
  int n = 0;
  for (const char* name : kConcave) {
    for (const auto& [coding, patterns] :
         {std::pair<const char*, Patterns>{"heterodyne", heterodyne}, {"XOR Gray", gray_xor}}) {
      size_t images = 0;
      const Errors errors = errors_of(name, seeds, patterns, {}, images);
      const double wrong = share(errors.wrong_order, errors.compared),
                   dishonest = share(errors.dishonest, errors.compared), valid = share(errors.compared, errors.lit);
      std::fprintf(stderr,
                   "  %-9s, %zu images of %s: bias %.4f mm; wrong orders %.1e; beyond 4 sigmas %.1e; pixels with "
                   "depth %.3f\n",
                   name, images, coding, 1e3 * errors.bias_m(seeds), wrong, dishonest, valid);
      worst_wrong = std::max(worst_wrong, wrong);
      worst_dishonest = std::max(worst_dishonest, dishonest);
      least_valid = std::min(least_valid, valid);
      n += seeds;
    }
  }
  return {bound_row("indirect.others.wrong_order", worst_wrong, n, "share", 1e-3, Limit::most),
          bound_row("indirect.others.honest", worst_dishonest, n, "share", 1e-3, Limit::most),
          bound_row("indirect.others.valid", least_valid, n, "share", 0.98, Limit::least)};
}

}  // namespace

std::vector<Item> indirect_items() {
  return {{{"indirect.bias", "indirect.wrong_order", "indirect.honest", "indirect.valid", "indirect.images"},
           "depth in grooves, a bowl and a corner: micro phase shifting relative to nine images of three periods",
           indirect_rows},
          {{"indirect.others.wrong_order", "indirect.others.honest", "indirect.others.valid"},
           "depth there: heterodyne phase shifting with short periods, and a Gray code combined by XOR",
           other_rows}};
}

}  // namespace fringeslam::bench

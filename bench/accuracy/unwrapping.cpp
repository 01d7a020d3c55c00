// SPDX-License-Identifier: Apache-2.0
// The unwrapping methods, each through the whole pipeline over one trajectory: number of images and accuracy.
#include <cmath>
#include <cstdio>

#include "bench/row.h"
#include "core/mapper/pipeline.h"
#include "core/score/score.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

struct Way {
  Unwrapping unwrapping;
  std::vector<double> periods_px;  // three steps each
};

struct Totals {
  int views = 0, lost = 0;
  double images = 0, valid_fraction = 0, pixels = 0, wrong = 0;
  std::vector<double> median_mm;
  double ate_mm = 0;  // views that were not lost
};

void add(const FrameResult& view, const TruthFrame& truth, double finest_period_px, Totals& totals) {
  ++totals.views;
  totals.lost += !has_pose(view.tracking);
  totals.images += view.images;
  cv::Mat1f depth;
  cv::extractChannel(view.frame.points_m, depth, 2);
  const DepthScore score =
      score_depth({depth, view.frame.sigma_m, view.decoded.coordinate_px}, truth, finest_period_px);
  totals.valid_fraction += score.valid_fraction;
  if (score.compared == 0) return;
  totals.pixels += score.compared;
  totals.wrong += score.wrong_order * score.compared;
  totals.median_mm.push_back(1e3 * score.median_m);
}

Totals over_loop(const Way& way, size_t views) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml", {3});
  scene.trajectory.resize(std::min(views, scene.trajectory.size()));
  const Pinhole& projector = scene.rig.projector;
  const PatternSequence sequence =
      phase_shift_sequence(projector.width, projector.height, way.periods_px, 3, Axis::columns, 8);
  PipelineOptions options;
  options.decode.unwrapping = way.unwrapping;
  Pipeline pipeline(scene.rig, sequence, options, scene.trajectory[0].world_from_robot);
  sim::VirtualRig rig(scene, {});
  Totals totals;
  while (const auto view = rig.simulate(pipeline.next_patterns()))
    add(pipeline.process(view->stack), view->truth, way.periods_px.back(), totals);
  totals.ate_mm = 1e3 * score_trajectory(pipeline.trajectory(), scene.trajectory).ate_rmse_m;
  return totals;
}

std::vector<Row> unwrapping_rows(const Context& context) {
  const Way ways[] = {{Unwrapping::multifrequency, {1040, 131, 16.5}},
                      {Unwrapping::spatial, {1040, 131, 16.5}},
                      {Unwrapping::geometric, {480}},
                      {Unwrapping::predicted, {1040, 131, 16.5}}};
  double predicted = NAN;
  int pixels = 0;
  for (const Way& way : ways) {
    const Totals t = over_loop(way, context.quick ? 26 : 1000);
    const double wrong = t.wrong / t.pixels;
    std::fprintf(
        stderr,
        "  %-14s %4.1f images per view, %5.1f %% of the lit pixels, %.1e of %.1f million wrong, median error %.4f "
        "mm, %d of %d views lost, ATE %.4f mm\n",
        to_string(way.unwrapping), t.images / t.views, 100 * t.valid_fraction / t.views, wrong, 1e-6 * t.pixels,
        median_of(t.median_mm), t.lost, t.views, t.ate_mm);
    if (way.unwrapping == Unwrapping::predicted) predicted = wrong, pixels = static_cast<int>(t.pixels);
  }
  return {bound_row("wrong_order.predicted", predicted, pixels, "share", 1e-3, Limit::most)};
}

}  // namespace

std::vector<Item> unwrapping_items() {
  return {{{"wrong_order.predicted"}, "fringe orders over a loop, by all unwrapping methods", unwrapping_rows}};
}

}  // namespace fringeslam::bench

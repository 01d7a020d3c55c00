// SPDX-License-Identifier: Apache-2.0
// Poses of single images, compared with those of views: a robot on scenes/loop at 0.3 m/s.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/row.h"
#include "core/mapper/image_trajectory.h"
#include "core/mapper/pipeline.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {
namespace {

// Sums over poses.
struct PoseErrors {
  double square_m2 = 0, square_rad2 = 0, nees = 0;
  int count = 0, lost = 0;

  void add(const Pose& found, const Pose& truth, const Matrix6d& covariance) {
    const Vector6d error = difference(found, truth);
    square_rad2 += error.head<3>().squaredNorm();
    square_m2 += error.tail<3>().squaredNorm();
    nees += error.dot(solve_symmetric(covariance, error));
    ++count;
  }
  double rms_m() const { return std::sqrt(square_m2 / std::max(1, count)); }
  double rms_rad() const { return std::sqrt(square_rad2 / std::max(1, count)); }
  void print(const char* name) const {
    std::fprintf(stderr, "  %-22s %4d poses, %d lost: RMS %6.1f um, %6.1f urad, NEES %5.2f\n", name, count, lost,
                 1e6 * rms_m(), 1e6 * rms_rad(), nees / std::max(1, count));
  }
};

struct Errors {
  PoseErrors views, finest, others;  // images of the finest fringes, and of other patterns of complete stacks
};

// Runs the pipeline and the tracker of images; errors are relative to the first view.
Errors errors_along_the_loop(uint64_t seed, int views) {
  constexpr int kSettled = 3;  // views until the motion is known
  sim::SceneLoadOptions reading;
  reading.seed = seed;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml", reading);
  sim::VirtualRig rig(scene, {});
  PipelineOptions options;
  options.decode.unwrapping = Unwrapping::predicted;
  Pipeline pipeline(rig.model(), scene.patterns, options, {});
  ImageTrajectory images(rig.model(), scene.patterns);
  const double finest_px = finest_patterns(scene.patterns, Axis::columns).patterns.front().period_px;
  const Pose& mount = scene.rig.robot_from_camera;
  Pose map_from_truth;
  Errors errors;
  for (int i = 0; i < views; ++i) {
    const sim::SimulatedView view = *rig.simulate(pipeline.next_patterns());
    const FringeStack& stack = view.stack;
    const FrameResult result = pipeline.process(stack);
    images.add(stack, result, pipeline.mapper());
    for (size_t k = 0; i >= kSettled && k < stack.images.size(); ++k) {
      const ImageOfRun& image = images.images()[images.images().size() - stack.images.size() + k];
      PoseErrors& sums = stack.patterns.patterns[k].period_px == finest_px ? errors.finest : errors.others;
      sums.lost += !image.tracked;
      if (image.tracked)
        sums.add(pipeline.mapper().world_from_frame(image.view) * image.reference_from_camera,
                 map_from_truth * view.truth.exposures[k].world_from_robot * mount, image.covariance);
    }
    errors.views.lost += result.tracking == Tracking::lost;
    if (result.tracking == Tracking::lost) continue;
    const Pose found = pipeline.mapper().world_from_camera(result.view), truth = view.truth.world_from_robot * mount;
    if (i == 0) map_from_truth = found * truth.inverse();
    if (i < kSettled) continue;
    // In the axes of the map, as the error; the covariance of a view is in those of its keyframe.
    const Pose& keyframe = pipeline.map().keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
    errors.views.add(found, map_from_truth * truth, rotated_covariance(keyframe.rotation, result.covariance));
  }
  return errors;
}

std::vector<Row> image_pose_rows(const Context& context) {
  const int seeds = context.quick ? 1 : 5, views = context.quick ? 20 : 40;
  std::vector<double> ratios;
  int lost = 0, images = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Errors errors = errors_along_the_loop(static_cast<uint64_t>(seed), views);
    errors.views.print("views");
    errors.finest.print("images, finest fringes");
    errors.others.print("images, other patterns");
    ratios.push_back(
        std::max(errors.finest.rms_m() / errors.views.rms_m(), errors.finest.rms_rad() / errors.views.rms_rad()));
    lost += errors.finest.lost;
    images += errors.finest.lost + errors.finest.count;
  }
  return {median_row("moving.image", ratios, "x", 3),
          bound_row("moving.image.lost", lost, images, "images", 0, Limit::most)};
}

}  // namespace

std::vector<Item> image_pose_items() {
  return {{{"moving.image", "moving.image.lost"},
           "RMS error of the poses of single images of the finest fringes relative to that of views, the larger of "
           "position "
           "and rotation, 0.3 m/s",
           image_pose_rows}};
}

}  // namespace fringeslam::bench

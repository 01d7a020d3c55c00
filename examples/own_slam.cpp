// SPDX-License-Identifier: Apache-2.0
// Runs another SLAM system on our frames and scores it: own_slam SCENE.yaml. The system here is the simplest one:
// point-to-point ICP from frame to frame.
#include <fringeslam/fringeslam.h>

#include <cstdio>
#include <optional>

using namespace fringeslam;

namespace {

// Returns the motion that aligns `current` with `previous`: correspondences by projection, closed-form alignment.
Pose align(const Frame& previous, const Frame& current, const Pinhole& camera) {
  constexpr int kStep = 4, kIterations = 60;
  Pose previous_from_current;
  for (int i = 0; i < kIterations; ++i) {
    const double gate_m = std::max(0.004, 0.06 * std::pow(0.9, i));
    std::vector<Eigen::Vector3d> to, from;
    for (int row = 0; row < current.height(); row += kStep) {
      for (int col = 0; col < current.width(); col += kStep) {
        if (!current.valid(row, col)) continue;
        const cv::Vec3f& p = current.points_m(row, col);
        const Eigen::Vector3d point(p[0], p[1], p[2]), moved = previous_from_current * point;
        const Eigen::Vector2d pixel = camera.project(moved);
        const int c = static_cast<int>(std::lround(pixel.x())), r = static_cast<int>(std::lround(pixel.y()));
        if (c < 0 || r < 0 || c >= previous.width() || r >= previous.height() || !previous.valid(r, c)) continue;
        const cv::Vec3f& q = previous.points_m(r, c);
        const Eigen::Vector3d there(q[0], q[1], q[2]);
        if ((there - moved).norm() > gate_m) continue;
        to.push_back(there);
        from.push_back(point);
      }
    }
    if (to.size() < 100) break;
    previous_from_current = align_points(to, from);
  }
  return previous_from_current;
}

}  // namespace

int main(int argc, char** argv) {
  const sim::Scene scene = sim::load_scene(argc > 1 ? argv[1] : "scenes/rubble_pile/scene.yaml");
  sim::VirtualRig rig(scene, {});
  const RigModel& model = rig.model();
  const FringeFrontEnd front_end(model, scene.patterns, {});

  Trajectory trajectory;
  std::optional<Frame> previous;
  Pose world_from_camera = scene.trajectory.front().world_from_robot * model.robot_from_camera;
  while (const auto stack = rig.capture(scene.patterns)) {
    const Frame frame = front_end.reconstruct(*stack, {}).frame;
    if (previous) world_from_camera = world_from_camera * align(*previous, frame, model.camera);
    trajectory.push_back({frame.timestamp_s, world_from_camera * model.robot_from_camera.inverse()});
    previous = frame;
  }

  const TrajectoryScore score = score_trajectory(trajectory, scene.trajectory);
  std::printf("%d poses, ATE %.2f mm, RPE %.2f mm\n", score.poses, 1e3 * score.ate_rmse_m,
              1e3 * score.rpe_translation_rmse_m);
  return score.poses == static_cast<int>(scene.trajectory.size()) ? 0 : 1;
}

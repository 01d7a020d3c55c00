// SPDX-License-Identifier: Apache-2.0
// Implements a rig: own_rig. This one computes the images of a textured corner of two walls, in front of which it moves
// sideways by 5 mm per view; replace capture() by your camera and projector.
#include <fringeslam/fringeslam.h>

#include <cmath>
#include <cstdio>

using namespace fringeslam;

class CornerRig : public Rig {
 public:
  explicit CornerRig(int views) : views_(views) {
    model_.name = "corner";
    model_.camera = {320, 240, 360, 360, 159.5, 119.5, {}};
    model_.projector = {1024, 768, 1100, 1100, 511.5, 383.5, {}};
    model_.projector_from_camera.translation = {-0.25, 0, 0};
    rays_ = pixel_rays(model_.camera);
  }

  const RigModel& model() const override { return model_; }

  std::optional<FringeStack> capture(const PatternSequence& sequence) override {
    if (next_ == views_) return std::nullopt;
    FringeStack stack;
    stack.index = next_++;
    stack.timestamp_s = 0.1 * stack.index;
    stack.patterns = sequence;
    for (size_t i = 0; i < sequence.patterns.size(); ++i) {
      stack.images.push_back(image_of(sequence.patterns[i], 0.005 * stack.index));
      stack.exposure_s.push_back(1e-3);
      stack.exposure_time_s.push_back(stack.timestamp_s + 0.01 * (static_cast<double>(i) - 4));
    }
    return stack;
  }

 private:
  cv::Mat1b image_of(const Pattern& pattern, double shift_m) const {
    cv::Mat1b image(model_.camera.height, model_.camera.width);
    for (int row = 0; row < image.rows; ++row) {
      for (int col = 0; col < image.cols; ++col) {
        // Walls x = ±(z - 1.2 m) meet at the edge x = 0, z = 1.2 m of the world; the camera is at x = shift_m.
        const double x = rays_(row, col)[0], y = rays_(row, col)[1];
        const double left = (1.2 + shift_m) / (1 - x), right = (1.2 - shift_m) / (1 + x);
        const double depth = std::max(0.1, std::min(left, right));
        const Eigen::Vector3d point(x * depth, y * depth, depth);
        const Eigen::Vector2d lit = model_.projector.project(model_.projector_from_camera * point);
        const double u = point.x() + shift_m, v = point.y();
        const double albedo = 0.6 + 0.2 * std::sin(90 * u) * std::sin(110 * v) + 0.15 * std::sin(310 * u + 170 * v * v);
        image(row, col) = cv::saturate_cast<uchar>(5 + 200 * albedo * ideal_intensity(pattern, lit.x()));
      }
    }
    return image;
  }

  RigModel model_;
  PixelRays rays_;
  int views_, next_ = 0;
};

int main() {
  CornerRig rig(8);
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  Pipeline pipeline(rig.model(), sequence, {}, Pose{});
  Driver(rig, pipeline).run([](const MappedView& view) {
    const Eigen::Vector3d position_mm = 1e3 * view.result.world_from_robot.translation;
    std::printf("view %d: %s, at %.2f %.2f %.2f mm\n", view.stack.index, to_string(view.result.tracking).c_str(),
                position_mm.x(), position_mm.y(), position_mm.z());
  });
  const Trajectory trajectory = pipeline.trajectory();
  return trajectory.size() == 8 && std::abs(trajectory.back().world_from_robot.translation.norm() - 0.035) < 1e-3 ? 0
                                                                                                                  : 1;
}

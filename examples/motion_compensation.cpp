// SPDX-License-Identifier: Apache-2.0
// Compares a moving view's depth with ground truth, decoded as if the camera stood still and with its motion:
// motion_compensation SCENE.yaml PICTURE.png [SPEED_M_S].
#include <fringeslam/fringeslam.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

using namespace fringeslam;

namespace {

constexpr float kScale_m = 5e-3f;  // full colour
constexpr float kColours = 5;      // of each sign

struct ErrorPicture {
  cv::Mat3b picture;  // blue: too near, red: too far, grey: no depth
  double median_m = 0;
  double covered = 0;  // share of the pixels
};

ErrorPicture error_picture(const Frame& frame, const TruthFrame& truth) {
  ErrorPicture result{cv::Mat3b(frame.points_m.size(), cv::Vec3b(120, 120, 120))};
  std::vector<float> errors;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const float error = frame.points_m(row, col)[2] - truth.depth_m(row, col);
      if (std::isnan(error)) continue;
      errors.push_back(std::abs(error));
      // Few colours make small files.
      const float share = std::round(kColours * std::min(1.f, std::abs(error) / kScale_m)) / kColours;
      const auto faded = static_cast<uchar>(255 * (1 - share));
      result.picture(row, col) = error > 0 ? cv::Vec3b(faded, faded, 255) : cv::Vec3b(255, faded, faded);
    }
  }
  if (errors.empty()) return result;
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  result.median_m = *middle;
  result.covered = static_cast<double>(errors.size()) / static_cast<double>(frame.points_m.total());
  return result;
}

cv::Mat3b captioned(const ErrorPicture& error, const char* how) {
  char text[100];
  std::snprintf(text, sizeof text, "%s: error %.2f mm (median), depth in %.0f %%", how, 1e3 * error.median_m,
                100 * error.covered);
  cv::Mat3b picture;
  cv::copyMakeBorder(error.picture, picture, 28, 4, 4, 4, cv::BORDER_CONSTANT, cv::Scalar::all(255));
  cv::putText(picture, text, {6, 19}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(0), 1, cv::LINE_AA);
  return picture;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: motion_compensation SCENE.yaml PICTURE.png [SPEED_M_S]\n");
    return 2;
  }
  sim::SceneLoadOptions loading;
  loading.changes = {{"trajectory.continuous.speed_m_s", argc > 3 ? argv[3] : "0.3"}};
  const sim::Scene scene = sim::load_scene(argv[1], loading);
  sim::VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, scene.trajectory.front().world_from_robot);
  const auto view = rig.simulate(pipeline.next_patterns());
  const FringeFrontEnd front_end(rig.model(), scene.patterns, {});
  const ErrorPicture before = error_picture(front_end.reconstruct(view->stack, {}).frame, view->truth);
  // The first view has no prediction: its motion is estimated from its own images.
  const ErrorPicture after = error_picture(pipeline.process(view->stack).frame, view->truth);
  cv::Mat both;
  cv::hconcat(captioned(before, "As if at rest"), captioned(after, "With its motion"), both);
  cv::imwrite(argv[2], both);
  std::printf("median depth error %.3f mm as if at rest, %.3f mm with the motion; depth in %.0f %% and %.0f %%\n",
              1e3 * before.median_m, 1e3 * after.median_m, 100 * before.covered, 100 * after.covered);
  return after.median_m < before.median_m && after.covered > before.covered ? 0 : 1;
}

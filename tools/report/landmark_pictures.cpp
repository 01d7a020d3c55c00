// SPDX-License-Identifier: Apache-2.0
#include "tools/report/landmark_pictures.h"

#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace {

constexpr double kTextureWhite = 160;  // a texture rarely exceeds half of full scale

// Distinct colours on grey, one per landmark, repeating after the last.
cv::Scalar colour_of(int number) {
  static const std::array<cv::Scalar, 10> colours = {
      cv::Scalar(80, 175, 255),  cv::Scalar(90, 210, 90),  cv::Scalar(235, 160, 60), cv::Scalar(200, 110, 230),
      cv::Scalar(60, 220, 240),  cv::Scalar(90, 90, 240),  cv::Scalar(215, 215, 80), cv::Scalar(150, 200, 160),
      cv::Scalar(190, 160, 255), cv::Scalar(120, 160, 200)};
  return colours[static_cast<size_t>(number) % colours.size()];
}
const cv::Scalar kUnclustered(130, 130, 130), kKeypoint(90, 210, 90);

cv::Point2d to_point(const Eigen::Vector2d& p) { return {p.x(), p.y()}; }

void draw_keypoint(cv::Mat3b& picture, const Eigen::Vector2d& pixel, double scale, double angle_rad,
                   const cv::Scalar& colour) {
  const cv::Point2d centre = to_point(pixel);
  const double radius = std::max(2.0, scale);
  cv::circle(picture, centre, static_cast<int>(std::lround(radius)), colour, 1, cv::LINE_AA);
  const cv::Point2d way(radius * std::cos(angle_rad), radius * std::sin(angle_rad));
  cv::line(picture, centre, centre + way, colour, 1, cv::LINE_AA);
}

cv::Mat3b dimmed(const cv::Mat1b& image, double share) { return grey_picture(image, 255 / share); }

void draw_outline(cv::Mat3b& picture, const Landmark& landmark, const cv::Scalar& colour, const cv::Point& shift = {}) {
  std::vector<cv::Point> outline;
  for (const cv::Point& p : landmark.outline) outline.push_back(p + shift);
  cv::polylines(picture, std::vector<std::vector<cv::Point>>{outline}, true, colour, 2, cv::LINE_AA);
}

}  // namespace

cv::Mat3b texture_keypoints_picture(const FrameResult& view) {
  cv::Mat3b picture = grey_picture(view.frame.texture, kTextureWhite);
  for (const Keypoint& k : view.keypoints.keypoints) draw_keypoint(picture, k.pixel, k.scale, k.angle_rad, kKeypoint);
  return picture;
}

cv::Mat3b depth_keypoints_picture(const FrameResult& view, const LandmarkStages& stages) {
  cv::Mat3b picture = dimmed(stages.levels, 0.8);
  for (const DepthKeypoint& k : view.landmarks.depth_keypoints)
    draw_keypoint(picture, k.pixel, k.scale, k.angle_rad, kKeypoint);
  return picture;
}

cv::Mat3b cluster_picture(const FrameResult& view, const LandmarkStages& stages) {
  cv::Mat3b picture = dimmed(stages.levels, 0.6);
  picture.setTo(cv::Scalar(235, 235, 235), stages.conditioned.cleaned);
  const auto& keypoints = view.landmarks.depth_keypoints;
  for (const cv::Vec2i& c : view.landmarks.connections) {
    const DepthKeypoint &a = keypoints[static_cast<size_t>(c[0])], &b = keypoints[static_cast<size_t>(c[1])];
    cv::line(picture, to_point(a.pixel), to_point(b.pixel), colour_of(a.cluster), 1, cv::LINE_AA);
  }
  for (const DepthKeypoint& k : keypoints)
    cv::circle(picture, to_point(k.pixel), 3, k.cluster < 0 ? kUnclustered : colour_of(k.cluster), cv::FILLED,
               cv::LINE_AA);
  return picture;
}

cv::Mat3b landmark_picture(const FrameResult& view) {
  cv::Mat3b picture = grey_picture(view.frame.texture, kTextureWhite);
  const Landmarks& landmarks = view.landmarks;
  for (size_t l = 0; l < landmarks.landmarks.size(); ++l) {
    const cv::Scalar colour = colour_of(static_cast<int>(l));
    draw_outline(picture, landmarks.landmarks[l], colour);
    for (const int k : landmarks.landmarks[l].keypoints)
      cv::circle(picture, to_point(landmarks.keypoints.keypoints[static_cast<size_t>(k)].pixel), 2, colour, cv::FILLED,
                 cv::LINE_AA);
  }
  return picture;
}

cv::Mat3b recognition_picture(const FrameResult& earlier, int earlier_keyframe, const FrameResult& current) {
  cv::Mat3b picture;
  cv::hconcat(grey_picture(earlier.frame.texture, kTextureWhite), grey_picture(current.frame.texture, kTextureWhite),
              picture);
  const cv::Point shift(earlier.frame.width(), 0);
  for (const Landmark& landmark : earlier.landmarks.landmarks) draw_outline(picture, landmark, kUnclustered);
  for (const Landmark& landmark : current.landmarks.landmarks) draw_outline(picture, landmark, kUnclustered, shift);
  for (const Recognition& r : current.recognitions) {
    if (r.earlier_frame != earlier_keyframe) continue;
    const cv::Scalar colour = colour_of(r.landmark);
    draw_outline(picture, earlier.landmarks.landmarks[static_cast<size_t>(r.earlier_landmark)], colour);
    draw_outline(picture, current.landmarks.landmarks[static_cast<size_t>(r.landmark)], colour, shift);
    for (const KeypointMatch& match : r.matches) {
      const cv::Point2d from = to_point(earlier.keypoints.keypoints[static_cast<size_t>(match.earlier)].pixel);
      const cv::Point2d to =
          to_point(current.keypoints.keypoints[static_cast<size_t>(match.current)].pixel) + cv::Point2d(shift);
      cv::line(picture, from, to, colour, 1, cv::LINE_AA);
    }
  }
  return picture;
}

cv::Mat3b landmark_sheet(const FrameResult& view, const LandmarkStages& stages) {
  const Conditioned& c = stages.conditioned;
  const auto title = [](const std::string& what, size_t count) { return std::to_string(count) + " " + what; };
  return sheet({{{"depth", dimmed(stages.levels, 1)},
                 {"foreground", grey_picture(c.foreground, 255)},
                 {"edges", grey_picture(c.edges.mask(), 255)}},
                {{"dilated " + std::to_string(c.dilations) + " times", grey_picture(c.dilated.mask(), 255)},
                 {"thinned", grey_picture(c.thinned.mask(), 255)},
                 {"cleaned", grey_picture(c.cleaned, 255)}},
                {{title("depth keypoints in the foreground, clustered", view.landmarks.depth_keypoints.size()),
                  cluster_picture(view, stages)},
                 {title("landmarks", view.landmarks.landmarks.size()), landmark_picture(view)},
                 {title("texture keypoints", view.keypoints.keypoints.size()), texture_keypoints_picture(view)}}},
               view.frame.texture.size());
}

}  // namespace fringeslam::tools

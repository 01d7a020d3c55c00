// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/landmarks.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/landmarks/reference/hull.h"
#include "core/landmarks/regions.h"

namespace fringeslam {

namespace {

cv::Point rounded(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

// Discards keypoints on the background. A keypoint at a corner of the foreground may lie one pixel outside it.
int discard_background(std::vector<DepthKeypoint>& keypoints, const cv::Mat1b& foreground) {
  const auto on_background = [&](const DepthKeypoint& k) {
    const cv::Point p = rounded(k.pixel);
    const cv::Rect around = cv::Rect(p.x - 1, p.y - 1, 3, 3) & cv::Rect(0, 0, foreground.cols, foreground.rows);
    return cv::countNonZero(foreground(around)) == 0;
  };
  return static_cast<int>(std::erase_if(keypoints, on_background));
}

// Returns what lines must not cross: edges and the background; the latter keeps lines from connecting two objects
// around the outside.
cv::Mat1b barriers_of(const Frame& frame, const Conditioned& conditioned, const LandmarkOptions& options) {
  cv::Mat1b barriers = conditioned.cleaned.clone();
  if (!options.within_foreground) return barriers;
  for (int r = 0; r < frame.height(); ++r) {
    for (int c = 0; c < frame.width(); ++c) {
      // Pixels without depth may be shadows on the object itself.
      if (!conditioned.foreground(r, c) && frame.valid(r, c)) barriers(r, c) = 255;
    }
  }
  return barriers;
}

// Convex hull of the members; empty if they have none.
std::vector<cv::Point> hull_outline(const std::vector<int>& members, const std::vector<DepthKeypoint>& keypoints) {
  std::vector<Eigen::Vector2d> points;
  for (const int m : members) points.push_back(keypoints[static_cast<size_t>(m)].pixel);
  const ConvexHull hull = gift_wrap(points);
  std::vector<cv::Point> outline;
  if (hull.status != HullStatus::polygon) return outline;
  for (const int corner : hull.corners) outline.push_back(rounded(points[static_cast<size_t>(corner)]));
  return outline;
}

// Outline of the area enclosed by the cluster's lines; empty if they enclose none.
std::vector<cv::Point> line_outline(int cluster, const Landmarks& landmarks, const cv::Size& size) {
  cv::Mat1b drawn(size, uchar{0});
  const auto at = [&](int i) { return landmarks.depth_keypoints[static_cast<size_t>(i)]; };
  for (const cv::Vec2i& c : landmarks.connections) {
    if (at(c[0]).cluster == cluster) cv::line(drawn, rounded(at(c[0]).pixel), rounded(at(c[1]).pixel), 255);
  }
  std::vector<std::vector<cv::Point>> outlines;
  cv::findContours(drawn, outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
  std::vector<cv::Point> largest;
  double area = 0;
  for (const auto& outline : outlines) {
    const double a = cv::contourArea(outline);
    if (a > area) area = a, largest = outline;
  }
  return largest;
}

// Returns the keypoints whose pixel lies in the outline or within margin_px of it.
std::vector<int> keypoints_in(const std::vector<cv::Point>& outline, const Keypoints& keypoints, double margin_px) {
  const int margin = static_cast<int>(std::lround(margin_px));
  const cv::Rect box = cv::boundingRect(outline) + cv::Size(2 * margin, 2 * margin) - cv::Point(margin, margin);
  cv::Mat1b mask(box.size(), uchar{0});
  std::vector<cv::Point> polygon;
  for (const cv::Point& p : outline) polygon.push_back(p - box.tl());
  cv::fillPoly(mask, std::vector<std::vector<cv::Point>>{polygon}, 255);
  if (margin > 0) cv::polylines(mask, polygon, true, 255, 2 * margin + 1);
  std::vector<int> inside;
  for (size_t i = 0; i < keypoints.keypoints.size(); ++i) {
    const cv::Point p = rounded(keypoints.keypoints[i].pixel);
    if (box.contains(p) && mask(p - box.tl())) inside.push_back(static_cast<int>(i));
  }
  return inside;
}

void outline_clusters(const cv::Mat1b& levels, const cv::Mat1b& barriers, const ClusterOptions& options,
                      double margin_px, Landmarks& landmarks) {
  Clusters clusters = find_clusters(landmarks.depth_keypoints, levels, barriers, options);
  landmarks.connections = std::move(clusters.connections);
  for (size_t c = 0; c < clusters.members.size(); ++c) {
    Landmark landmark;
    landmark.depth_keypoints = std::move(clusters.members[c]);
    landmark.outline = options.method == ClusterMethod::depth_sampling
                           ? line_outline(static_cast<int>(c), landmarks, levels.size())
                           : hull_outline(landmark.depth_keypoints, landmarks.depth_keypoints);
    if (landmark.outline.size() < 3) {
      ++landmarks.without_hull;
      continue;
    }
    landmark.keypoints = keypoints_in(landmark.outline, landmarks.keypoints, margin_px);
    landmarks.landmarks.push_back(std::move(landmark));
  }
}

void outline_regions(const Conditioned& conditioned, const LandmarkOptions& options, Landmarks& landmarks) {
  cv::Mat1b area = conditioned.foreground.clone();
  area.setTo(0, conditioned.cleaned);
  Regions regions = find_regions(area, options.bridge_px, options.min_area_px);
  for (Region& region : regions.regions) {
    Landmark landmark;
    landmark.outline = std::move(region.outline);
    landmarks.landmarks.push_back(std::move(landmark));
  }
  const cv::Mat1b everywhere(area.size(), 255);
  grow_labels(regions.labels, everywhere, static_cast<int>(std::lround(options.margin_px)));
  for (size_t i = 0; i < landmarks.keypoints.keypoints.size(); ++i) {
    const int label = regions.labels(rounded(landmarks.keypoints.keypoints[i].pixel));
    if (label > 0) landmarks.landmarks[static_cast<size_t>(label - 1)].keypoints.push_back(static_cast<int>(i));
  }
  for (size_t i = 0; i < landmarks.depth_keypoints.size(); ++i) {
    DepthKeypoint& k = landmarks.depth_keypoints[i];
    const int label = regions.labels(rounded(k.pixel));
    if (label == 0) continue;
    std::vector<int>& members = landmarks.landmarks[static_cast<size_t>(label - 1)].depth_keypoints;
    k.cluster = label - 1;
    k.order = static_cast<int>(members.size());
    members.push_back(static_cast<int>(i));
  }
}

void drop_indistinct(const LandmarkOptions& options, Landmarks& landmarks) {
  landmarks.indistinct = static_cast<int>(std::erase_if(landmarks.landmarks, [&](const Landmark& landmark) {
    return static_cast<int>(landmark.keypoints.size()) < options.min_keypoints;
  }));
}

}  // namespace

Landmarks extract_landmarks(const Frame& frame, Keypoints keypoints, const RigModel& rig,
                            const KeypointOptions& keypoint_options, const ConditioningOptions& conditioning,
                            const ClusterOptions& cluster_options, const LandmarkOptions& options,
                            LandmarkStages* stages) {
  check_options(options, "landmarks");
  const Conditioned conditioned = condition(frame, conditioning);
  const cv::Mat1f depths = depth_levels(frame, rig.near_m, rig.far_m);
  cv::Mat1b levels;
  depths.convertTo(levels, CV_8U);

  Landmarks result;
  result.dilations = conditioned.dilations;
  result.keypoints = std::move(keypoints);
  result.depth_keypoints = detect_depth_keypoints(depths, keypoint_options);
  result.background_keypoints = discard_background(result.depth_keypoints, conditioned.foreground);
  if (options.outlines == OutlineSource::regions)
    outline_regions(conditioned, options, result);
  else
    outline_clusters(levels, barriers_of(frame, conditioned, options), cluster_options, options.margin_px, result);
  drop_indistinct(options, result);
  if (stages) *stages = {levels, conditioned};
  return result;
}

}  // namespace fringeslam

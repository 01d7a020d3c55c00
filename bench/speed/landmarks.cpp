// SPDX-License-Identifier: Apache-2.0
// Landmark detection and matching at 532 x 500 pixels, stage by stage.
#include <cstdio>
#include <opencv2/features2d.hpp>
#include <opencv2/ximgproc.hpp>

#include "bench/landmark_method.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/landmarks/morphology.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> conditioning_rows(const Context& context) {
  const ViewPair pair = rendered_pair("rubble_pile", 2);
  const Frame& frame = pair.views[0].frame;
  const ConditioningOptions options;
  const Conditioned conditioned = condition(frame, options);
  const cv::Mat1b dilated = conditioned.dilated.mask();
  cv::Mat theirs;
  BitImage ours(0, 0);
  const auto times =
      interleaved_times({[&] { condition(frame, options); }, [&] { cv::ximgproc::thinning(dilated, theirs); },
                         [&] { ours = thinned(conditioned.dilated); }},
                        context.quick ? 5 : 50);
  std::fprintf(stderr, "  thinning: OpenCV's (Zhang-Suen) %.1f ms, ours %.2f ms\n", 1e3 * median(times[1]),
               1e3 * median(times[2]));
  return {median_row("speed.conditioning", in_ms(times[0]), "ms", 3)};
}

// A given number of depth keypoints, evenly distributed over a depth image with its edges.
std::vector<DepthKeypoint> spread_keypoints(const cv::Mat1f& levels, size_t count) {
  KeypointOptions options;
  options.max_depth_keypoints = static_cast<int>(count);
  options.depth_contrast_threshold = 1e-4;
  options.depth_edge_threshold = 1000;
  options.depth_halved = false;
  std::vector<DepthKeypoint> keypoints = detect_depth_keypoints(levels, options);
  if (keypoints.size() > count) keypoints.resize(count);
  return keypoints;
}

std::vector<Row> cluster_rows(const Context& context) {
  const ViewPair pair = rendered_pair("rubble_pile", 2);
  const Frame& frame = pair.views[0].frame;
  const cv::Mat1f levels = depth_levels(frame, pair.rig.near_m, pair.rig.far_m);
  cv::Mat1b rounded;
  levels.convertTo(rounded, CV_8U);
  const cv::Mat1b edges = condition(frame, {}).cleaned;
  std::vector<DepthKeypoint> keypoints = spread_keypoints(levels, 300);
  std::vector<std::function<void()>> works;
  ClusterOptions methods[2];
  methods[1].method = ClusterMethod::convex_hull;
  for (const ClusterOptions& method : methods)
    works.push_back([&] { find_clusters(keypoints, rounded, edges, method); });
  const auto times = interleaved_times(works, context.quick ? 5 : 50);
  std::fprintf(stderr, "  %zu depth keypoints: depth sampling %.2f ms, region search %.2f ms\n", keypoints.size(),
               1e3 * median(times[0]), 1e3 * median(times[1]));
  return {median_row("speed.clusters", in_ms(times[0]), "ms", 3)};
}

// A database of 200 landmarks of other views, and a second view of one of them.
std::vector<Row> recognition_rows(const Context& context) {
  const LandmarkMethod method;
  const ViewPair pair = rendered_pair("boxes_and_foam", 1);
  LandmarkDatabase database(pair.rig.camera, method.recognition);
  LandmarkMethod unguided = method;
  unguided.recognition.guided = false;
  LandmarkDatabase plain(pair.rig.camera, unguided.recognition);
  for (uint64_t seed = 2; database.landmarks() < 200; ++seed) {
    const ViewPair other = rendered_pair("boxes_and_foam", seed);
    for (const View& view : other.views) {
      const Landmarks landmarks = landmarks_of(other, view, method);
      database.add(database.landmarks(), landmarks);
      plain.add(plain.landmarks(), landmarks);
    }
  }
  database.add(1000000, landmarks_of(pair, pair.views[0], method));
  plain.add(1000000, landmarks_of(pair, pair.views[0], method));
  const Landmarks current = landmarks_of(pair, pair.views[1], method);
  const auto times = interleaved_times({[&] { database.reidentify(current); }, [&] { plain.reidentify(current); }},
                                       context.quick ? 5 : 50);
  int queries = 0;
  for (const Landmark& landmark : current.landmarks) queries += static_cast<int>(landmark.keypoints.size());
  std::fprintf(stderr, "  %d keypoints of %zu landmarks against %d of %d: %.2f ms, without the guided search %.2f ms\n",
               queries, current.landmarks.size(), database.keypoints(), database.landmarks(), 1e3 * median(times[0]),
               1e3 * median(times[1]));
  return {median_row("speed.recognition", in_ms(times[0]), "ms", 2)};
}

std::vector<Row> keypoint_rows(const Context& context) {
  const ViewPair pair = rendered_pair("rubble_pile", 2);
  const Frame& frame = pair.views[0].frame;
  const cv::Mat1f levels = depth_levels(frame, pair.rig.near_m, pair.rig.far_m);
  const KeypointOptions options;
  const auto times = interleaved_times(
      {[&] { detect_keypoints(frame, pair.rig, pair.rays, options); }, [&] { detect_depth_keypoints(levels, options); },
       [&] {
         std::vector<cv::KeyPoint> found;
         cv::Mat descriptors;
         cv::SIFT::create(options.max_keypoints, 3, options.contrast_threshold)
             ->detectAndCompute(frame.texture, {}, found, descriptors);
       }},
      context.quick ? 3 : 20);
  std::fprintf(stderr, "  texture with descriptors %.1f ms (OpenCV's SIFT %.1f ms), depth image %.1f ms\n",
               1e3 * median(times[0]), 1e3 * median(times[2]), 1e3 * median(times[1]));
  std::vector<double> both;
  for (size_t i = 0; i < times[0].size(); ++i) both.push_back(times[0][i] + times[1][i]);
  return {median_row("speed.keypoints", in_ms(both), "ms", 100)};
}

}  // namespace

std::vector<Item> landmark_speed_items() {
  return {{{"speed.conditioning"}, "background, edges, dilation, thinning, loose ends", conditioning_rows},
          {{"speed.clusters"}, "clusters of 300 depth keypoints", cluster_rows},
          {{"speed.recognition"}, "a view's landmarks matched against 200 of earlier views", recognition_rows},
          {{"speed.keypoints"}, "SIFT of both images", keypoint_rows}};
}

}  // namespace fringeslam::bench

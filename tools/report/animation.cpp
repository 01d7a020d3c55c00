// SPDX-License-Identifier: Apache-2.0
#include "tools/report/animation.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "core/io/files.h"
#include "core/io/image_library.h"
#include "core/io/image_worker.h"
#include "core/map/map_cloud.h"
#include "core/types/error.h"
#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace {

constexpr int kFramesPerSecond = 6, kLastFrame = 8;  // the last one is shown this many times
const cv::Size kSmall(200, 188), kMap(410, 404);

cv::Mat3b small(const cv::Mat3b& picture) {
  cv::Mat3b result;
  cv::resize(picture, result, kSmall, 0, 0, cv::INTER_AREA);
  return result;
}

}  // namespace

void Animation::add(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map) {
  if (!has_pose(result.tracking)) return;
  ++tracked_;
  if (seen_++ % every_ != 0) return;
  cv::Mat1f depth;
  cv::extractChannel(result.frame.points_m, depth, 2);
  samples_.push_back({small(grey_picture(stack.images.back(), 0.8 * rig_.sensor.max_dn())),
                      small(false_colour(depth, rig_.near_m, rig_.far_m)), map.frames().size(), tracked_});
}

void Animation::write(const std::filesystem::path& file, const Mapper& mapper, const CloudOptions& options) const {
  if (samples_.empty()) throw Error("animation: no view was tracked, so there is nothing to draw");
  const KeyframeMap& map = mapper.map();
  const std::vector<CloudPoint> whole = cloud_of(map, options);
  CloudMap growing(cell_m_of(map.rig(), options));
  size_t added = 0;
  std::vector<Pose> cameras;
  std::vector<cv::Mat3b> frames;
  for (const Sample& sample : samples_) {
    for (; added < sample.frames; ++added) {
      const MapFrame& frame = map.frames()[added];
      growing.add(restored(frame.frame, map.rays()), map.world_from_camera(frame));
    }
    while (static_cast<int>(cameras.size()) < sample.views)
      cameras.push_back(mapper.world_from_camera(static_cast<int>(cameras.size())));
    cv::Mat3b left, picture;
    cv::vconcat(std::vector<cv::Mat3b>{sample.fringes,
                                       cv::Mat3b(kMap.height - 2 * kSmall.height, kSmall.width, cv::Vec3b(24, 22, 20)),
                                       sample.depth},
                left);
    cv::hconcat(left, map_picture(growing.points(), cameras, kMap, &whole), picture);
    frames.push_back(picture);
  }
  for (int i = 1; i < kLastFrame; ++i) frames.push_back(frames.back());
  prepare_image_decoding();
  write_text(file, image_library().gif_bytes(frames, kFramesPerSecond, file.string()));
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/sensor_picture.h"

#include <algorithm>

#include "core/io/files.h"
#include "tools/report/view_pictures.h"

namespace fringeslam::tools {

namespace {

uchar mask_level(float bits) {
  const int mask = static_cast<int>(bits);
  if (!(mask & kTruthSurface)) return 0;
  if (!(mask & kTruthInBeam)) return kOutOfBeamLevel;
  return mask & kTruthInShadow ? kShadowLevel : kLitLevel;
}

}  // namespace

std::string sensor_picture(sim::SensorView& view, const RigModel& rig, SensorPicture kind, size_t pattern,
                           const Pose& world_from_robot, bool reduced, const sim::Stop& stop) {
  cv::Mat1b picture;
  if (kind == SensorPicture::texture || kind == SensorPicture::pattern) {
    const auto shown = kind == SensorPicture::pattern ? std::optional(pattern) : std::nullopt;
    const cv::Mat image = view.image(world_from_robot, shown, reduced, stop);
    image.convertTo(picture, CV_8U, 255 / rig.sensor.max_dn());
  } else {
    const TruthFrame truth = view.truth(world_from_robot, reduced, stop);
    if (kind == SensorPicture::depth) {
      picture = levels(truth.depth_m, rig.near_m, rig.far_m);
    } else {
      picture.create(truth.mask.size());
      std::transform(truth.mask.begin(), truth.mask.end(), picture.begin(), mask_level);
    }
  }
  return picture.empty() ? std::string() : png_bytes(picture);
}

}  // namespace fringeslam::tools

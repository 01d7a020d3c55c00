// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/sensor_picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/io/files.h"
#include "core/types/error.h"
#include "tools/mappable.h"
#include "tools/report/view_pictures.h"

namespace fringeslam::tools {

namespace {

uchar mask_level(float bits) {
  const int mask = static_cast<int>(bits);
  if (!(mask & kTruthSurface)) return 0;
  if (!(mask & kTruthInBeam)) return kOutOfBeamLevel;
  return mask & kTruthInShadow ? kShadowLevel : kLitLevel;
}

cv::Mat1b wrong_order_levels(sim::SensorView& view, const Pose& world_from_robot, const sim::Stop& stop) {
  const auto stack = view.stack({0, world_from_robot}, stop);
  if (!stack) return {};
  const DecodedStack decoded = decode(stack->stack, view.reduced_rig(), {});
  cv::Mat1f power(decoded.confidence.size());
  std::transform(decoded.confidence.begin(), decoded.confidence.end(), power.begin(), [](float confidence) {
    return std::max(static_cast<float>(kLeastWrongOrder), std::log10(1 - confidence));  // NaN without a fringe order
  });
  power.setTo(kNaN, decoded.coordinate_px != decoded.coordinate_px);
  // Light from other surfaces leads to wrong orders without noise, too.
  cv::Mat1f off_px;
  cv::absdiff(decoded.coordinate_px, stack->truth.projector_column, off_px);
  power.setTo(static_cast<float>(kMostWrongOrder), off_px > decoded.finest_period_px / 2);
  return levels(power, kLeastWrongOrder, kMostWrongOrder);
}

}  // namespace

std::vector<SensorPicture> pictures_of(const sim::Scene& scene) {
  using enum SensorPicture;
  std::vector<SensorPicture> pictures = {texture, pattern, depth, mask};
  try {
    check_mappable(scene.rig, scene.patterns, {});
    pictures.push_back(wrong_order);
  } catch (const Error&) {
    // The patterns determine no fringe orders by themselves.
  }
  if (sim::has_indirect_light(scene)) pictures.push_back(indirect);
  const bool warm = std::any_of(scene.objects.begin(), scene.objects.end(), [&](const sim::Object& object) {
    return object.material.warmer_k != 0 || object.material.temperature_c.has_value();
  });
  if (warm) pictures.push_back(temperature);
  return pictures;
}

std::pair<double, double> temperature_range_c(const sim::Scene& scene) {
  double low = scene.surroundings_c, high = low;
  for (const sim::Object& object : scene.objects) {
    const double here_c = object.material.temperature_c.value_or(scene.surroundings_c + object.material.warmer_k);
    low = std::min(low, here_c);
    high = std::max(high, here_c);
  }
  return {low, std::max(high, low + 1)};
}

std::string sensor_picture(sim::SensorView& view, const sim::Scene& scene, SensorPicture kind, size_t pattern,
                           const Pose& world_from_robot, bool reduced, const sim::Stop& stop) {
  const RigModel& rig = scene.rig;
  cv::Mat1b picture;
  const auto truth = [&] { return view.truth(world_from_robot, reduced, stop); };
  switch (kind) {
    case SensorPicture::texture:
    case SensorPicture::pattern: {
      const auto shown = kind == SensorPicture::pattern ? std::optional(pattern) : std::nullopt;
      view.image(world_from_robot, shown, reduced, stop).convertTo(picture, CV_8U, 255 / rig.sensor.max_dn());
      break;
    }
    case SensorPicture::depth:
      picture = levels(truth().depth_m, rig.near_m, rig.far_m);
      break;
    case SensorPicture::mask: {
      const cv::Mat1f mask = truth().mask;
      picture.create(mask.size());
      std::transform(mask.begin(), mask.end(), picture.begin(), mask_level);
      break;
    }
    case SensorPicture::wrong_order:
      picture = wrong_order_levels(view, world_from_robot, stop);
      break;
    case SensorPicture::indirect:
      picture = levels(view.indirect_share(world_from_robot, reduced, stop), 0, 1);
      break;
    case SensorPicture::temperature: {
      const auto [low_c, high_c] = temperature_range_c(scene);
      picture = levels(truth().temperature_c, low_c, high_c);
      break;
    }
  }
  return picture.empty() ? std::string() : png_bytes(picture);
}

}  // namespace fringeslam::tools

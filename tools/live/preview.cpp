// SPDX-License-Identifier: Apache-2.0
#include "tools/live/preview.h"

#include <algorithm>
#include <limits>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/types/error.h"
#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace {

constexpr double kMuchSaturated = 0.01, kLittleLight = 0.05, kLittleDepth = 0.1;
const cv::Vec3b kRed(0, 0, 255);

struct Extremes {
  cv::Mat brightest, darkest;
};

Extremes extremes_of(const FringeStack& stack) {
  if (stack.images.empty()) throw Error("preview: the stack has no images");
  Extremes result{stack.images.front().clone(), stack.images.front().clone()};
  for (const cv::Mat& image : stack.images) {
    if (image.size() != result.brightest.size() || image.type() != result.brightest.type())
      throw Error("preview: the stack's images differ in size or type");
    result.brightest = cv::max(result.brightest, image);
    result.darkest = cv::min(result.darkest, image);
  }
  return result;
}

bool coded(const PatternSequence& sequence, Axis axis, bool fringes_only) {
  return std::any_of(sequence.patterns.begin(), sequence.patterns.end(), [&](const Pattern& p) {
    return p.axis == axis &&
           (p.coding == Coding::fringe || ((p.coding == Coding::gray || p.coding == Coding::product) && !fringes_only));
  });
}

bool determines_orders(const PatternSequence& sequence, const RigModel& rig, Axis axis) {
  if (!coded(sequence, axis, false)) return false;
  try {
    resolve_unwrapping(sequence, rig, {}, {.axis = axis});
    return true;
  } catch (const Error&) {
    return false;
  }
}

Axis coded_axis(const PatternSequence& sequence) {
  return coded(sequence, Axis::columns, false) ? Axis::columns : Axis::rows;
}

cv::Mat1b depth_of(const DecodedStack& decoded, const Triangulation& triangulation, const RigModel& rig) {
  Frame frame;
  triangulate(frame, decoded, triangulation, {});
  return depth_image(frame.points_m, rig.near_m, rig.far_m);
}

cv::Mat1b grey(const cv::Mat& image, double white) {
  cv::Mat1b picture;
  image.convertTo(picture, CV_8U, 255 / white);
  return picture;
}

double image_share(const cv::Mat& mask) {
  return static_cast<double>(cv::countNonZero(mask)) / static_cast<double>(mask.total());
}

// Adds what needs no decoding.
void add_light(Preview& preview, const cv::Mat& brightest, double full) {
  const cv::Mat clipped = brightest >= DecodeOptions().saturation * full;
  preview.figures.full_scale_dn = full;
  preview.figures.saturated = image_share(clipped);
  preview.figures.brightness = cv::mean(brightest)[0] / full;
  preview.saturation = grey_picture(brightest, full);
  preview.saturation.setTo(kRed, clipped);
}

}  // namespace

DecodedStack decode_without_orders(const FringeStack& stack, const RigModel& rig, Axis axis) {
  if (stack.images.empty()) throw Error("decode: the stack has no images");
  const cv::Mat1f nowhere(stack.images.front().size(), std::numeric_limits<float>::quiet_NaN());
  const CoordinatePrior nothing{nowhere, nowhere, nowhere};
  DecodeOptions options;
  options.unwrapping = Unwrapping::predicted;
  return decode(stack, rig, options, {.axis = axis, .expected = &nothing});
}

std::optional<Triangulation> preview_triangulation(const PatternSequence& sequence, const RigModel& rig) {
  const Axis axis = coded_axis(sequence);
  if (!determines_orders(sequence, rig, axis)) return std::nullopt;
  // The union of the pipeline's and the rig's range.
  const DepthOptions options;
  return Triangulation(rig, pixel_rays(rig.camera), std::min(options.near_m, rig.near_m),
                       std::max(options.far_m, rig.far_m), axis);
}

Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig) {
  return preview_of(stack, sequence, rig, preview_triangulation(sequence, rig));
}

Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                   const std::optional<Triangulation>& triangulation) {
  if (stack.images.size() != sequence.patterns.size())
    throw Error("preview: the stack has " + std::to_string(stack.images.size()) + " images, the sequence " +
                std::to_string(sequence.patterns.size()));
  const auto [brightest, darkest] = extremes_of(stack);
  const double full = rig.sensor.max_dn();
  const Axis axis = coded_axis(sequence);

  Preview preview;
  PreviewFigures& figures = preview.figures;
  figures.depth_possible = triangulation.has_value();
  preview.depth = cv::Mat1b(brightest.size(), 0);
  cv::Mat1f mean, modulation;
  if (triangulation) {
    const DecodedStack decoded = decode(stack, rig, {}, {.axis = axis});
    mean = decoded.mean, modulation = decoded.modulation;
    preview.depth = depth_of(decoded, *triangulation, rig);
  } else if (coded(sequence, axis, true)) {
    const DecodedStack decoded = decode_without_orders(stack, rig, axis);
    mean = decoded.mean, modulation = decoded.modulation;
  } else {
    cv::Mat1f high, low;
    brightest.convertTo(high, CV_32F);
    darkest.convertTo(low, CV_32F);
    mean = (high + low) / 2;
    modulation = (high - low) / 2;
  }
  add_light(preview, brightest, full);
  figures.valid = image_share(preview.depth);
  figures.mean_modulation_dn = cv::mean(modulation)[0];
  preview.texture = grey(mean, kTextureWhite * full);
  preview.modulation = grey(modulation, full / 2);
  return preview;
}

Preview preview_of(const FringeStack& stack, const RigModel& rig, const cv::Mat1b& texture,
                   const cv::Mat1f& modulation_dn, const cv::Mat1b& depth) {
  Preview preview;
  const double full = rig.sensor.max_dn();
  add_light(preview, extremes_of(stack).brightest, full);
  preview.figures.valid = image_share(depth);
  preview.figures.mean_modulation_dn = cv::mean(modulation_dn)[0];
  preview.texture = grey(texture, kTextureWhite * 255);
  preview.modulation = grey(modulation_dn, full / 2);
  preview.depth = depth;
  return preview;
}

std::vector<std::string> warnings(const PreviewFigures& figures) {
  std::vector<std::string> sentences;
  if (figures.saturated > kMuchSaturated)
    sentences.push_back("Too bright: the red pixels are saturated and cannot be decoded. Reduce exposure or gain.");
  const bool dark = figures.brightness < kLittleLight;
  if (dark) sentences.push_back("Too dark: is the projector on? If so, increase exposure or gain.");
  if (figures.depth_possible && figures.valid < kLittleDepth && !dark)
    sentences.push_back("Hardly any depth: is the scene in the projector's field and within the rig's range?");
  return sentences;
}

}  // namespace fringeslam::tools

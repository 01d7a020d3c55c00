// SPDX-License-Identifier: Apache-2.0
// A sequence of patterns as light: at a point of the projector's image, the light of all of them at once, 0 black to 1
// white, through the projector's response and with its black level. So a lit point is looked up once, whatever the
// number of patterns, and adds to the sums of all of them.
//
// Without blur the light is interpolated between pixel centres and clamped at the image's border. With it a pixel is
// an even square, blurred by a Gaussian: tables for a ladder of sigmas, dense at the sharp end, hold the result four
// times a pixel, and are interpolated in sigma^2. Fringes of continuous intensity are exact everywhere: their
// modulation is multiplied by exp(-2 pi^2 sigma^2 / p^2).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"

namespace fringeslam::sim {

// Sigmas of the blur that points of a scene may have, px. Both 0: none, not even that of square pixels.
struct BlurRange {
  double least = 0, largest = 0;
};

class ShownPatterns {
 public:
  ShownPatterns(const PatternSequence& sequence, const RigModel& rig, const BlurRange& blur);
  // Any images of the projector's size, input levels from 0 to 1. Those that change along one axis alone are the same
  // as their patterns would be, and quicker than others.
  ShownPatterns(const std::vector<cv::Mat1f>& images, const RigModel& rig, const BlurRange& blur);

  int count() const { return count_; }
  // Floats of one set of sums: `count` and what pads them.
  int stride() const { return stride_; }
  // Where in the sums pattern `i` of the sequence is.
  int slot(int i) const { return slots_[static_cast<size_t>(i)]; }

  // Points of the projector's image that a packet's lanes are lit from.
  struct Points {
    alignas(64) float column[16], row[16], blur_px[16], weight[16];
  };
  // sums[lane * stride + slot(i)] += weight * light_i(column, row) for the lanes whose bit is set.
  void add(const Points& points, uint32_t lanes, float* sums) const;

 private:
  // Patterns that change along one axis alone, or not at all.
  struct Profile {
    bool along_columns = true;
    int first = 0, width = 0;                // of the sums
    int positions = 0;                       // entries along the axis
    std::vector<std::vector<float>> levels;  // by blur; position-major
  };
  struct Image {  // dithered patterns change along both
    int slot = 0;
    std::vector<cv::Mat1f> levels;  // by blur
  };
  struct Wave {  // of continuous intensity
    int slot = 0;
    Axis axis = Axis::columns;
    double turns_per_px = 0, shift_turns = 0;
  };

  void add_images(const Points& points, uint32_t lanes, float* sums) const;
  void add_waves(const Points& points, uint32_t lanes, float* sums) const;
  ShownPatterns(int count, const RigModel& rig, const BlurRange& blur);
  void add_image(int i, const cv::Mat1f& light);
  // `lights`: of these patterns, along the axis alone; of one pixel where they do not change along it either.
  void add_profile(Axis axis, int length, const std::vector<int>& patterns, const std::vector<cv::Mat1f>& lights);

  int count_ = 0, stride_ = 0, per_px_ = 1;
  float black_ = 0;
  std::vector<int> slots_;
  // Level k of n + 1 has sigma least + (largest - least) (k / n)^2.
  BlurRange blur_;
  std::vector<double> sigmas_;
  std::vector<Profile> profiles_;
  std::vector<Image> images_;
  std::vector<Wave> waves_;
};

}  // namespace fringeslam::sim

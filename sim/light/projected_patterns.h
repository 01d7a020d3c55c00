// SPDX-License-Identifier: Apache-2.0
// Projected light of a pattern sequence: at a point of the projector image, the light of all patterns, from 0 (black)
// to 1 (white), including the projector's response and black level (docs/method.md, section 12.1). A lit point needs
// one lookup for all patterns and is added to all their sums.
//
// Without blur, the light is interpolated between pixel centres and clamped at the image border. With blur, a pixel is
// a uniform square convolved with a Gaussian: tables for a series of blur levels, denser at small sigmas, store four
// values per pixel and are interpolated in sigma^2. Fringes of continuous intensity are evaluated in closed form: their
// modulation is multiplied by exp(-2 pi^2 sigma^2 / p^2).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"

namespace fringeslam::sim {

// Range of blur sigmas in the scene, px. Both 0: no blur, not even that of square pixels.
struct BlurRange {
  double least = 0, largest = 0;
};

class ProjectedPatterns {
 public:
  ProjectedPatterns(const PatternSequence& sequence, const RigModel& rig, const BlurRange& blur);
  // Uses arbitrary images of the projector's size, input levels from 0 to 1. Images that vary along one axis only give
  // the same light as the corresponding patterns and are faster.
  ProjectedPatterns(const std::vector<cv::Mat1f>& images, const RigModel& rig, const BlurRange& blur);

  int count() const { return count_; }
  // Returns the length of one set of sums, in floats: count() plus padding.
  int stride() const { return stride_; }
  // Returns the index of pattern `i` in the sums.
  int slot(int i) const { return slots_[static_cast<size_t>(i)]; }

  // Projector coordinates that light a packet's lanes.
  struct Points {
    alignas(64) float column[16], row[16], blur_px[16], weight[16];
  };
  // sums[lane * stride + slot(i)] += weight * light_i(column, row) for the lanes whose bit is set.
  void add(const Points& points, uint32_t lanes, float* sums) const;

 private:
  // Table of the patterns that vary along one axis only, or are constant.
  struct Profile {
    bool along_columns = true;
    int first = 0, width = 0;                // range of the sums, with padding
    int positions = 0;                       // entries along the axis
    std::vector<std::vector<float>> levels;  // by blur level; position-major
  };
  struct Image {  // pattern that varies along both axes (dithered)
    int slot = 0;
    std::vector<cv::Mat1f> levels;  // by blur level
  };
  struct Wave {  // fringe of continuous intensity, evaluated in closed form
    int slot = 0;
    Axis axis = Axis::columns;
    double turns_per_px = 0, shift_turns = 0;
  };

  void add_images(const Points& points, uint32_t lanes, float* sums) const;
  void add_waves(const Points& points, uint32_t lanes, float* sums) const;
  ProjectedPatterns(int count, const RigModel& rig, const BlurRange& blur);
  void add_image(int i, const cv::Mat1f& light);
  // `lights`: one line per pattern along the axis, or one pixel for a constant pattern.
  void add_profile(Axis axis, int length, const std::vector<int>& patterns, const std::vector<cv::Mat1f>& lights);

  int count_ = 0, stride_ = 0, per_px_ = 1;
  float black_ = 0;
  std::vector<int> slots_;
  // Blur level k = 0 ... n has sigma = least + (largest - least) (k / n)^2.
  BlurRange blur_;
  std::vector<double> sigmas_;
  std::vector<Profile> profiles_;
  std::vector<Image> images_;
  std::vector<Wave> waves_;
};

}  // namespace fringeslam::sim

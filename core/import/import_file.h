// SPDX-License-Identifier: Apache-2.0
// import.yaml: which image of a folder shows which pattern, and which calibration belongs to it. The keys are
// documented in core/rig/README.md.
//
// Fringes of other rigs become ours (core/patterns/patterns.h). They project
//
//   1/2 + 1/2 wave(2 pi u' / p + phase_offset + shift_k),  wave = cos or sin,  shift_k = shift_sign k 360 deg / N
//
// where u' is 0 at the centre of the projector's first pixel (coordinate_origin: pixel_centre) or at its edge
// (pixel_edge). Our phase is Phi = 2 pi (u + 1/2) / p with u integer at pixel centres, so u' = u or u' = u + 1/2, and
//
//   delta_k = phase_offset + shift_k - (90 deg for sin) - (180 deg / p for pixel_centre)
//
// A rig whose phase falls along u, cos(shift - 2 pi u' / p), is the same with the signs of offset and shift changed.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/io/files.h"
#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Camera figures that the file may leave out; what is negative is filled in for the images' bit depth.
struct ImportCamera {
  int bits = 0;              // 0: those of the image files
  bool msb_aligned = false;  // fewer bits than the file's stand at the top of its words
  GreyFrom grey_from = GreyFrom::luminance;
  double gain_dn_per_electron = -1, dark_noise_electrons = -1, full_well_electrons = -1, offset_dn = -1;
};

struct ImportPlan {
  std::filesystem::path config;
  RigModel rig;  // camera size 0 where the calibration does not tell; lenses and pose 0 unless rig.calibrated
  ImportCamera camera;
  PatternSequence sequence;
  std::vector<std::vector<std::filesystem::path>> stacks;  // an image a pattern
  double interval_s = 1;                                   // between stacks
  double exposure_s = 0.01;
  std::string board_yaml;  // board.yaml of the dataset; empty: none
};

// `folder` holds the images. Throws Error, file:line, for anything that is missing, double, unused or contradictory.
ImportPlan read_import(const std::filesystem::path& config, const std::filesystem::path& folder);

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Reader of import.yaml, which assigns patterns and a calibration to the images of a folder. The keys are documented in
// core/rig/README.md.
//
// Fringes of other rigs are converted to the convention of core/patterns/patterns.h. They project
//
//   1/2 + 1/2 wave(2 pi u' / p + phase_offset + shift_k),  wave = cos or sin,  shift_k = shift_sign k 360 deg / N
//
// where u' is 0 at the centre of the projector's first pixel (coordinate_origin: pixel_centre) or at its edge
// (pixel_edge). Here the phase is Phi = 2 pi (u + 1/2) / p with u integer at pixel centres, so u' = u or u' = u + 1/2,
// and
//
//   delta_k = phase_offset + shift_k - (90 deg for sin) - (180 deg / p for pixel_centre)
//
// If the phase decreases along u, cos(shift - 2 pi u' / p), the signs of offset and shift are negated.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/io/files.h"
#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Origin of the camera's noise parameters. automatic: measured if the images allow it, otherwise defaults.
enum class NoiseSource { automatic, measured, defaults, file };

// Camera parameters that the file may omit; negative values are replaced by defaults for the bit depth of the images.
struct ImportCamera {
  int bits = 0;              // 0: bit depth of the image files
  bool msb_aligned = false;  // values occupy the most significant bits
  GreyFrom grey_from = GreyFrom::luminance;
  double gain_dn_per_electron = -1, dark_noise_electrons = -1, full_well_electrons = -1, offset_dn = -1;
  NoiseSource noise = NoiseSource::automatic;
  std::filesystem::path noise_file;  // rig.yaml with the noise parameters, for NoiseSource::file
};

struct ImportPlan {
  std::filesystem::path config;
  RigModel rig;  // camera size 0 if not in the calibration; intrinsics and pose 0 unless rig.calibrated
  ImportCamera camera;
  PatternSequence sequence;
  std::vector<double> offset_rad;  // phase shift of step 0 of each pattern's period; 0 for other patterns
  std::vector<std::vector<std::filesystem::path>> stacks;  // one image per pattern
  double interval_s = 1;                                   // between stacks
  double image_interval_s = 0;                             // between images of a stack; 0: unknown
  std::vector<std::vector<double>> image_times_s;          // middles of the exposures, per stack; empty: unknown
  bool has_image_times() const { return image_interval_s > 0 || !image_times_s.empty(); }
  double exposure_s = 0.01;
  std::string board_yaml;                          // content of the dataset's board.yaml; empty: none
  std::vector<std::filesystem::path> named_files;  // by the description, beside the images of the stacks
};

// The description, the files that it names, and the folders of the images.
std::vector<std::filesystem::path> inputs_of(const ImportPlan& plan);

// The fringe images of a ROS bag: section `bag:` of import.yaml.
struct BagSelection {
  std::string topic;  // empty: the only one with images
  int first = 0;      // images before the first stack
  int per_stack = 0;
  int stacks = 0;  // 0: as many as there are
};

// In the folder of each stack of an unpacked bag.
constexpr const char* kBagTimesFile = "image_times.txt";

// Reads the section `bag:` alone. Throws Error with file:line if it is missing or invalid.
BagSelection read_bag_selection(const std::filesystem::path& config);

// Reads import.yaml for the images in `folder`; with `unpacked_bag`, its subfolders are the stacks of a bag. Throws Error
// with file:line for anything missing, duplicated, unused or contradictory.
ImportPlan read_import(const std::filesystem::path& config, const std::filesystem::path& folder,
                       bool unpacked_bag = false);

}  // namespace fringeslam

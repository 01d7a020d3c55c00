// SPDX-License-Identifier: Apache-2.0
#include "core/import/import.h"

#include <algorithm>
#include <cmath>

#include "core/base/in_order.h"
#include "core/io/yaml.h"
#include "core/rig/rig_file.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

// Assumed for an unknown industrial camera at base gain: full scale corresponds to about its full well.
constexpr double kFullScaleElectrons = 38250;

int file_bits(const cv::Mat& image) { return image.depth() == CV_8U ? 8 : 16; }

SensorModel sensor_of(const ImportCamera& camera, int bits) {
  constexpr double kMostElectrons = 1e9;  // of a rig file
  SensorModel sensor;
  const auto given_or = [](double given, double fallback) { return given >= 0 ? given : fallback; };
  sensor.bits = bits;
  sensor.gain_dn_per_electron = given_or(camera.gain_dn_per_electron, sensor.max_dn() / kFullScaleElectrons);
  sensor.dark_noise_electrons = given_or(camera.dark_noise_electrons, sensor.dark_noise_electrons);
  sensor.offset_dn = given_or(camera.offset_dn, 0);
  // An assumed full well must not limit the gray values.
  const double full_scale_electrons = std::ceil((sensor.max_dn() - sensor.offset_dn) / sensor.gain_dn_per_electron);
  sensor.full_well_electrons = given_or(camera.full_well_electrons,
                                        std::clamp(full_scale_electrons, sensor.full_well_electrons, kMostElectrons));
  return sensor;
}

// Initial values for a calibration: both focal lengths twice the image width, camera and projector side by side, with
// axes that meet in the middle of the working range.
void set_nominal_geometry(RigModel& rig) {
  for (Pinhole* device : {&rig.camera, &rig.projector}) {
    device->fx = device->fy = 2.0 * device->width;
    device->cx = 0.5 * (device->width - 1), device->cy = 0.5 * (device->height - 1);
  }
  const double distance_m = 0.5 * (rig.near_m + rig.far_m), baseline_m = 0.25 * distance_m;
  rig.projector_from_camera.rotation = rotation_exp({0, std::atan2(baseline_m, distance_m), 0});
  rig.projector_from_camera.translation = -(rig.projector_from_camera.rotation * Eigen::Vector3d(baseline_m, 0, 0));
}

std::string size_text(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

// Applies the checks of rig.yaml files.
void check_rig(const RigModel& rig, const fs::path& config) {
  try {
    read_rig(YamlMap::parse(to_yaml(rig), "rig.yaml"));
  } catch (const Error& e) {
    // Remove the location: its line refers to a text that is not stored anywhere.
    const std::string message = e.what();
    throw Error(config.string() + ": the described rig is invalid: " + message.substr(message.find(": ") + 2) +
                (rig.calibrated ? " (check unit_m, direction, near_m and far_m)" : ""));
  }
}

}  // namespace

ImportedRig::ImportedRig(ImportPlan plan) : plan_(std::move(plan)), model_(plan_.rig), first_(plan_.stacks[0][0]) {
  const cv::Mat image = read_as_grey(first_, plan_.camera.grey_from);
  type_ = image.type();
  Pinhole& camera = model_.camera;
  if (camera.width > 0 && (camera.width != image.cols || camera.height != image.rows))
    throw Error(first_.string() + ": is " + size_text(image.cols, image.rows) + " but the calibration is for a " +
                size_text(camera.width, camera.height) + " camera; use the images it was made for");
  camera.width = image.cols, camera.height = image.rows;
  if (image.depth() == CV_32F && plan_.camera.bits == 0)
    throw Error(plan_.config.string() +
                ": the images are floating point; add `camera: {bits: N}` to set "
                "full scale to 2^N - 1");
  const int bits = plan_.camera.bits > 0 ? plan_.camera.bits : file_bits(image);
  if (bits > file_bits(image))
    throw Error(first_.string() + ": has " + std::to_string(file_bits(image)) + " bits per pixel, but camera.bits is " +
                std::to_string(bits));
  model_.sensor = sensor_of(plan_.camera, bits);
  if (!model_.calibrated) set_nominal_geometry(model_);
  check_rig(model_, plan_.config);
}

void ImportedRig::recalibrate(const RigModel& calibration) {
  try {
    model_ = with_calibration(model_, calibration);
  } catch (const Error& e) {
    throw Error(first_.string() + ": " + e.what());
  }
  check_rig(model_, plan_.config);
}

void ImportedRig::set_sensor(const SensorModel& sensor) {
  if (sensor.bits != model_.sensor.bits)
    throw Error(first_.string() + ": has " + std::to_string(model_.sensor.bits) +
                " bits per pixel, but the noise parameters are for a camera with " + std::to_string(sensor.bits));
  model_.sensor = sensor;
}

cv::Mat ImportedRig::read(const fs::path& file) const {
  constexpr double kMost16Bits = 65535;
  const bool in_high_bits = plan_.camera.msb_aligned && CV_MAT_DEPTH(type_) == CV_16U;
  cv::Mat image = read_as_grey(file, plan_.camera.grey_from, in_high_bits ? kMost16Bits : model_.sensor.max_dn());
  if (image.cols != model_.camera.width || image.rows != model_.camera.height)
    throw Error(file.string() + ": is " + size_text(image.cols, image.rows) + " but " + first_.string() + " is " +
                size_text(model_.camera.width, model_.camera.height) + "; all images must have the same size");
  if (image.type() != type_)
    throw Error(file.string() + ": has a different pixel type than " + first_.string() +
                "; all images must have the same type");
  if (in_high_bits) {
    // Shifted, not divided, because division would round: the low bits may hold a copy of the high bits.
    const int unused = file_bits(image) - model_.sensor.bits;
    for (auto pixel = image.begin<uint16_t>(); pixel != image.end<uint16_t>(); ++pixel)
      *pixel = static_cast<uint16_t>(*pixel >> unused);
  }
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  if (image.depth() != CV_32F && largest > model_.sensor.max_dn())
    throw Error(file.string() + ": has a grey value of " + to_text(largest) + ", which exceeds camera.bits: " +
                std::to_string(model_.sensor.bits) + "; correct bits, or set msb_aligned: true");
  return image;
}

std::optional<FringeStack> ImportedRig::capture(const PatternSequence& sequence) {
  if (!(sequence == plan_.sequence))
    throw Error(plan_.config.string() + ": the images belong to a different pattern sequence");
  if (next_ == plan_.stacks.size()) return std::nullopt;
  FringeStack stack;
  stack.index = static_cast<int>(next_);
  stack.timestamp_s = static_cast<double>(next_) * plan_.interval_s;
  stack.patterns = sequence;
  if (plan_.image_times_s.empty()) {
    stack.exposure_time_s = exposure_times_s(stack.timestamp_s, stack.patterns, model_.timing);
  } else {
    stack.exposure_time_s = plan_.image_times_s[next_];
    stack.timestamp_s = reference_time_s(stack.patterns, stack.exposure_time_s);
  }
  const std::vector<fs::path>& files = plan_.stacks[next_];
  in_order(
      files.size(), files.size(), [&](size_t i) { return read(files[i]); },
      [&](cv::Mat image) { stack.images.push_back(std::move(image)); });
  for (const Pattern& pattern : sequence.patterns) stack.exposure_s.push_back(pattern.exposure * plan_.exposure_s);
  ++next_;
  return stack;
}

}  // namespace fringeslam

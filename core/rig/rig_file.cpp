// SPDX-License-Identifier: Apache-2.0
#include "core/rig/rig_file.h"

#include <Eigen/Geometry>
#include <cmath>

#include "core/io/yaml.h"
#include "core/patterns/long_run_code.h"
#include "core/patterns/waveform.h"
#include "core/types/centikelvin.h"

namespace fringeslam {

namespace {

constexpr Range kPixels{1, 16384};
constexpr Range kFocal{1, 1e6};
constexpr Range kCentre{-1e5, 1e5};
constexpr Range kPeriod{2, 1e5};
constexpr Range kCell{0.5, 1e5};
constexpr Range kShift{-1e3, 1e3};
constexpr Range kFraction{0, 1};
constexpr Range kExposure{1e-3, 1e3};

// Minimum fraction of the image over which the lens mapping must be invertible. Calibrated polynomials of real lenses
// may fold in the extreme corners, where no board was observed; pixels there have NaN rays and no measurement.
constexpr double kLeastShare = 0.95;

// True if the lens maps the rays from the axis to this pixel one to one: the distorted radius must increase
// monotonically.
bool distortion_is_monotonic(const Pinhole& p, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d corner = p.undistort(pixel);
  if (!corner.allFinite()) return false;
  constexpr int kSteps = 64;
  double last = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double radius = p.distort(corner * i / kSteps).norm();
    if (radius <= last) return false;
    last = radius;
  }
  return true;
}

double invertible_share(const Pinhole& p) {
  constexpr int kGrid = 32;
  int good = 0;
  for (int i = 0; i < kGrid; ++i) {
    for (int j = 0; j < kGrid; ++j)
      good += distortion_is_monotonic(p, {p.width * (i + 0.5) / kGrid - 0.5, p.height * (j + 0.5) / kGrid - 0.5});
  }
  return static_cast<double>(good) / (kGrid * kGrid);
}

Pinhole read_pinhole(const YamlMap& map) {
  Pinhole p;
  p.width = map.integer("width_px", kPixels);
  p.height = map.integer("height_px", kPixels);
  p.fx = map.number("fx_px", kFocal);
  p.fy = map.number("fy_px", kFocal);
  p.cx = map.number("cx_px", kCentre);
  p.cy = map.number("cy_px", kCentre);
  if (map.has("distortion")) {
    const std::vector<double> d = map.numbers("distortion", 5, {-1e4, 1e4});
    p.distortion = {d[0], d[1], d[2], d[3], d[4]};
  }
  if (const double share = p.distortion.is_zero() ? 1 : invertible_share(p); share < kLeastShare)
    throw map.error("distortion", "the distortion cannot be inverted over " + to_text(std::round(100 * (1 - share))) +
                                      " % of the image; check its coefficients");
  return p;
}

SensorModel read_sensor(const YamlMap& map) {
  SensorModel s;
  s.bits = map.integer("bits", {8, 16});
  s.gain_dn_per_electron = map.number("gain_dn_per_electron", {1e-6, 1e3});
  s.dark_noise_electrons = map.number("dark_noise_electrons", {0, 1e5});
  s.full_well_electrons = map.number("full_well_electrons", {1, 1e9});
  s.offset_dn = map.number("offset_dn", {0, 0.5 * s.max_dn()});
  s.quantum_efficiency = map.number_or("quantum_efficiency", s.quantum_efficiency, {1e-3, 1});
  s.dark_current_electrons_s = map.number_or("dark_current_electrons_s", s.dark_current_electrons_s, {0, 1e7});
  s.dsnu_electrons = map.number_or("dsnu_electrons", s.dsnu_electrons, {0, 1e5});
  s.prnu = map.number_or("prnu", s.prnu, {0, 0.5});
  return s;
}

constexpr Range kBlur{0, 50};
constexpr Range kExponent{0, 20};
constexpr Range kFocus{0.01, 1000};

CameraLens read_camera_lens(const YamlMap& map) {
  CameraLens lens;
  lens.pixel_m = map.number_or("pixel_m", lens.pixel_m, {1e-7, 1e-3});
  lens.f_number = map.number_or("f_number", lens.f_number, {0.5, 128});
  lens.focus_m = map.number_or("focus_m", lens.focus_m, kFocus);
  lens.transmission = map.number_or("transmission", lens.transmission, {1e-6, 1});
  lens.blur_px = map.number_or("blur_px", lens.blur_px, kBlur);
  lens.vignetting = map.number_or("vignetting", lens.vignetting, kExponent);
  return lens;
}

ProjectorLens read_projector_lens(const YamlMap& map) {
  ProjectorLens lens;
  lens.flux_lm = map.number("flux_lm", {1e-6, 1e6});
  lens.efficacy_lm_w = map.number_or("efficacy_lm_w", lens.efficacy_lm_w, {1, 683});
  lens.wavelength_m = map.number_or("wavelength_m", lens.wavelength_m, {3e-7, 1.1e-6});
  lens.aperture_m = map.number_or("aperture_m", lens.aperture_m, {0, 1});
  lens.focus_m = map.number_or("focus_m", lens.focus_m, kFocus);
  lens.blur_px = map.number_or("blur_px", lens.blur_px, kBlur);
  lens.pixel_fill = map.number_or("pixel_fill", lens.pixel_fill, {0.1, 1});
  lens.vignetting = map.number_or("vignetting", lens.vignetting, kExponent);
  return lens;
}

Timing read_timing(const YamlMap& map) {
  Timing timing;
  timing.pattern_rate_hz = map.number_or("pattern_rate_hz", timing.pattern_rate_hz, {1e-3, 1e5});
  timing.camera_rate_hz = map.number_or("camera_rate_hz", timing.camera_rate_hz, {1e-3, 1e5});
  timing.exposure_s = map.number_or("exposure_s", 1 / timing.pattern_rate_hz, {1e-7, 1e3});
  if (timing.camera_rate_hz > timing.pattern_rate_hz)
    throw map.error("camera_rate_hz", "camera_rate_hz exceeds pattern_rate_hz: a pattern would be captured twice");
  if (timing.exposure_s > (1 + 1e-9) / timing.pattern_rate_hz)
    throw map.error("exposure_s", "exposure_s exceeds the display time of a pattern, 1 / pattern_rate_hz = " +
                                      to_text(1 / timing.pattern_rate_hz) + " s");
  return timing;
}

ThermalCamera read_thermal(const YamlMap& map) {
  ThermalCamera thermal;
  thermal.lens = read_pinhole(map);
  thermal.netd_k = map.number_or("netd_k", thermal.netd_k, {0, 10});
  thermal.blur_px = map.number_or("blur_px", thermal.blur_px, kBlur);
  const std::vector<double> range = map.has("range_c")
                                        ? map.numbers("range_c", 2, {kColdestRecorded_c, kHottestRecorded_c})
                                        : std::vector<double>{thermal.coldest_c, thermal.hottest_c};
  if (range[1] <= range[0]) throw map.error("range_c", "range_c is [coldest, hottest]; the second must be larger");
  thermal.coldest_c = range[0];
  thermal.hottest_c = range[1];
  thermal.thermal_from_camera = map.pose("thermal_from_camera");
  return thermal;
}

PhaseCorrection read_phase_correction(const YamlMap& map) {
  return {map.integer("steps", {3, 1000}), map.numbers("offset_rad", 0, {-1.5, 1.5})};
}

std::string list(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + to_text(value);
  return text + "]";
}

std::string pinhole_lines(const Pinhole& p) {
  const Distortion& d = p.distortion;
  return "  width_px: " + std::to_string(p.width) + "\n  height_px: " + std::to_string(p.height) +
         "\n  fx_px: " + to_text(p.fx) + "\n  fy_px: " + to_text(p.fy) + "\n  cx_px: " + to_text(p.cx) +
         "\n  cy_px: " + to_text(p.cy) + "\n  distortion: " + list({d.k1, d.k2, d.p1, d.p2, d.k3}) + "\n";
}

std::string lens_lines(const CameraLens& lens) {
  return "  lens:\n    pixel_m: " + to_text(lens.pixel_m) + "\n    f_number: " + to_text(lens.f_number) +
         "\n    focus_m: " + to_text(lens.focus_m) + "\n    transmission: " + to_text(lens.transmission) +
         "\n    blur_px: " + to_text(lens.blur_px) + "\n    vignetting: " + to_text(lens.vignetting) + "\n";
}

std::string lens_lines(const ProjectorLens& lens) {
  return "  lens:\n    flux_lm: " + to_text(lens.flux_lm) + "\n    efficacy_lm_w: " + to_text(lens.efficacy_lm_w) +
         "\n    wavelength_m: " + to_text(lens.wavelength_m) + "\n    aperture_m: " + to_text(lens.aperture_m) +
         "\n    focus_m: " + to_text(lens.focus_m) + "\n    blur_px: " + to_text(lens.blur_px) +
         "\n    pixel_fill: " + to_text(lens.pixel_fill) + "\n    vignetting: " + to_text(lens.vignetting) + "\n";
}

std::string response_lines(const RigModel& rig) {
  std::string text;
  if (!rig.projector_response.empty()) text += "  response: " + list(rig.projector_response) + "\n";
  if (!rig.phase_correction.offset_rad.empty())
    text += "  phase_correction:\n    steps: " + std::to_string(rig.phase_correction.steps) +
            "\n    offset_rad: " + list(rig.phase_correction.offset_rad) + "\n";
  return text;
}

std::string pose_lines(const Pose& p, const std::string& indent = "  ") {
  const Eigen::Matrix3d& r = p.rotation;
  return indent + "translation_m: " + list({p.translation.x(), p.translation.y(), p.translation.z()}) + "\n" + indent +
         "rotation_matrix: " + list({r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)}) +
         "\n";
}

std::string thermal_lines(const RigModel& rig) {
  if (!rig.thermal) return "";
  const ThermalCamera& thermal = *rig.thermal;
  return "thermal:\n" + pinhole_lines(thermal.lens) + "  netd_k: " + to_text(thermal.netd_k) +
         "\n  blur_px: " + to_text(thermal.blur_px) + "\n  range_c: " + list({thermal.coldest_c, thermal.hottest_c}) +
         "\n  thermal_from_camera:\n" + pose_lines(thermal.thermal_from_camera, "    ");
}

Pattern read_pattern(const YamlMap& entry) {
  Pattern pattern;
  pattern.coding = entry.choice_or("coding", Coding::fringe);
  if (pattern.coding == Coding::flat) {
    pattern.level = entry.number("level", kFraction);
  } else {
    pattern.axis = entry.choice<Axis>("axis");
    pattern.period_px = entry.number("period_px", pattern.coding == Coding::gray ? kCell : kPeriod);
    if (pattern.coding == Coding::gray) {
      pattern.inverted = entry.boolean_or("inverted", false);
      pattern.carrier_px = entry.number_or("carrier_px", 0, kCell);
      pattern.code_bits = entry.integer_or("code_bits", 0, {0, kMostLongRunBits});
      if (pattern.code_bits > 0) pattern.code_bit = entry.integer("code_bit", {0, pattern.code_bits - 1.0});
      if (pattern.code_bits > 0 && pattern.carrier_px > 0)
        throw entry.error("carrier_px", "a bit of a code with long runs (code_bits) has no carrier_px");
    } else {
      pattern.shift_rad = entry.number("shift_rad", kShift);
    }
  }
  if (pattern.coding == Coding::product) {
    pattern.carrier_px = entry.number("carrier_px", kPeriod);
    pattern.carrier_shift_rad = entry.number("carrier_shift_rad", kShift);
  }
  pattern.bits = entry.integer_or("bits", 8, {0, 16});
  pattern.dithered = entry.boolean_or("dithered", false);
  pattern.exposure = entry.number_or("exposure", 1, kExposure);
  return pattern;
}

std::vector<double> read_periods(const YamlMap& map, const std::string& key) {
  constexpr size_t kMostPeriods = 100;
  std::vector<double> periods_px = map.numbers(key, 0, kPeriod);
  if (periods_px.size() > kMostPeriods)
    throw map.error(key, "'" + key + "' lists more than " + std::to_string(kMostPeriods) + " periods");
  return periods_px;
}

// Stripe widths of the Gray codes: a number or a list, 0 for the plain code.
std::vector<double> read_stripes(const YamlMap& map) {
  constexpr Range kStripe{0, 2e5};
  const std::string key = "gray_xor_px";
  if (map.yaml(key).starts_with('[')) return map.numbers(key, 0, kStripe);
  return {map.number(key, kStripe)};
}

std::string pattern_entry(const Pattern& p) {
  std::string text;
  if (p.coding != Coding::fringe) text = std::string("coding: ") + to_string(p.coding) + ", ";
  if (p.coding == Coding::flat)
    text += "level: " + to_text(p.level);
  else
    text += std::string("axis: ") + to_string(p.axis) + ", period_px: " + to_text(p.period_px);
  if (p.coding != Coding::flat && p.coding != Coding::gray) text += ", shift_rad: " + to_text(p.shift_rad);
  if (p.coding == Coding::product)
    text += ", carrier_px: " + to_text(p.carrier_px) + ", carrier_shift_rad: " + to_text(p.carrier_shift_rad);
  if (p.coding == Coding::gray && p.carrier_px > 0) text += ", carrier_px: " + to_text(p.carrier_px);
  if (p.code_bits > 0)
    text += ", code_bits: " + std::to_string(p.code_bits) + ", code_bit: " + std::to_string(p.code_bit);
  if (p.inverted) text += ", inverted: true";
  text += ", bits: " + std::to_string(p.bits);
  if (p.dithered) text += ", dithered: true";
  if (p.exposure != 1) text += ", exposure: " + to_text(p.exposure);
  return text;
}

}  // namespace

bool fields_overlap(const RigModel& rig) {
  constexpr int kGrid = 16;
  const double largest_r2 = rig.projector.largest_r2();
  for (int k = 0; k < kGrid; ++k) {
    const double z = rig.near_m + (rig.far_m - rig.near_m) * k / (kGrid - 1);
    for (int i = 0; i < kGrid; ++i) {
      for (int j = 0; j < kGrid; ++j) {
        const Eigen::Vector2d pixel(rig.camera.width * (i + 0.5) / kGrid, rig.camera.height * (j + 0.5) / kGrid);
        const Eigen::Vector3d in_camera = z * Eigen::Vector3d(rig.camera.undistort(pixel).homogeneous());
        const Eigen::Vector3d point = rig.projector_from_camera * in_camera;
        Eigen::Vector2d lit;
        if (rig.projector.shows(point, largest_r2, lit)) return true;
      }
    }
  }
  return false;
}

std::vector<double> read_response(const YamlMap& map, const char* table_key) {
  if (map.has("gamma")) {
    if (map.has(table_key)) throw map.error("gamma", std::string("specify gamma or ") + table_key + ", not both");
    return gamma_table(map.number("gamma", {0.2, 5}));
  }
  if (!map.has(table_key)) return {};
  const std::vector<double> table = map.numbers(table_key, 0, {0, 1});
  for (size_t i = 1; i < table.size(); ++i) {
    if (table[i] <= table[i - 1])
      throw map.error(table_key, std::string("the ") + table_key + " must increase strictly; entry " +
                                     std::to_string(i + 1) + " does not");
  }
  if (table.size() < 2) throw map.error(table_key, std::string("the ") + table_key + " needs at least two entries");
  return table;
}

RigModel read_rig(const YamlMap& map) {
  RigModel rig;
  rig.name = map.text("name");
  (void)map.has("hardware");  // read by the hardware backend
  rig.calibrated = map.boolean_or("calibrated", true);
  rig.near_m = map.number("near_m", {0.01, 100});
  rig.far_m = map.number("far_m", {0.01, 100});
  if (rig.far_m <= rig.near_m) throw map.error("far_m", "far_m must be larger than near_m");
  const YamlMap camera = map.map("camera");
  rig.camera = read_pinhole(camera);
  rig.sensor = read_sensor(camera.map("sensor"));
  const YamlMap projector = map.map("projector");
  rig.projector = read_pinhole(projector);
  if (camera.has("lens")) rig.camera_lens = read_camera_lens(camera.map("lens"));
  if (projector.has("lens")) rig.projector_lens = read_projector_lens(projector.map("lens"));
  if (map.has("timing")) rig.timing = read_timing(map.map("timing"));
  rig.projector_black_level = projector.number("black_level", {0, 0.5});
  rig.projector_response = read_response(projector, "response");
  if (projector.has("phase_correction"))
    rig.phase_correction = read_phase_correction(projector.map("phase_correction"));
  rig.projector_from_camera = map.pose("projector_from_camera");
  rig.robot_from_camera = map.pose("robot_from_camera");
  if (map.has("thermal")) rig.thermal = read_thermal(map.map("thermal"));
  if (translation_m(rig.projector_from_camera) < 1e-3)
    throw map.error("projector_from_camera",
                    "camera and projector have the same position: depth cannot be triangulated");
  if (!fields_overlap(rig))
    throw map.error("projector_from_camera",
                    "the projector illuminates nothing in the camera's view between near_m and far_m; "
                    "rotate or move it");
  return rig;
}

RigModel read_rig(const std::filesystem::path& file) {
  const YamlMap map = YamlMap::load(file);
  const RigModel rig = read_rig(map);
  map.finish();
  return rig;
}

std::string to_yaml(const RigModel& rig) {
  const SensorModel& s = rig.sensor;
  return "name: " + yaml_quoted(rig.name) + (rig.calibrated ? "" : "\ncalibrated: false") +
         "\nnear_m: " + to_text(rig.near_m) + "\nfar_m: " + to_text(rig.far_m) + "\ncamera:\n" +
         pinhole_lines(rig.camera) + "  sensor:\n    bits: " + std::to_string(s.bits) +
         "\n    gain_dn_per_electron: " + to_text(s.gain_dn_per_electron) +
         "\n    dark_noise_electrons: " + to_text(s.dark_noise_electrons) +
         "\n    full_well_electrons: " + to_text(s.full_well_electrons) + "\n    offset_dn: " + to_text(s.offset_dn) +
         "\n    quantum_efficiency: " + to_text(s.quantum_efficiency) +
         "\n    dark_current_electrons_s: " + to_text(s.dark_current_electrons_s) +
         "\n    dsnu_electrons: " + to_text(s.dsnu_electrons) + "\n    prnu: " + to_text(s.prnu) + "\n" +
         lens_lines(rig.camera_lens) + "projector:\n" + pinhole_lines(rig.projector) + lens_lines(rig.projector_lens) +
         "  black_level: " + to_text(rig.projector_black_level) + "\n" + response_lines(rig) +
         "timing:\n  pattern_rate_hz: " + to_text(rig.timing.pattern_rate_hz) +
         "\n  camera_rate_hz: " + to_text(rig.timing.camera_rate_hz) +
         "\n  exposure_s: " + to_text(rig.timing.exposure_s) + "\nprojector_from_camera:\n" +
         pose_lines(rig.projector_from_camera) + "robot_from_camera:\n" + pose_lines(rig.robot_from_camera) +
         thermal_lines(rig);
}

SequenceDesign read_design(const YamlMap& map, const RigModel& rig) {
  SequenceDesign design;
  design.width = rig.projector.width;
  design.height = rig.projector.height;
  const std::string axis = map.has("axis") ? map.choice("axis", {"columns", "rows", "both"}) : "columns";
  design.columns = axis != "rows";
  design.rows = axis != "columns";
  design.ramp_levels = map.integer_or("ramp_levels", 0, {0, 65536});
  const bool others = map.has("gray_cell_px") || map.has("extra_periods_px") || map.has("product_periods_px") ||
                      map.has("micro_period_px") || map.has("modulated_period_px");
  if (map.has("periods_px") || (design.ramp_levels == 0 && !others))
    design.periods_px = read_periods(map, "periods_px");
  if (map.has("extra_periods_px")) design.extra_periods_px = read_periods(map, "extra_periods_px");
  if (map.has("product_periods_px")) design.product_periods_px = read_periods(map, "product_periods_px");
  if (map.has("micro_period_px")) design.micro_period_px = map.number("micro_period_px", kPeriod);
  if (map.has("modulated_period_px")) design.modulated_period_px = map.number("modulated_period_px", kPeriod);
  design.micro_images = map.integer_or("micro_images", 0, {0, 64});
  if (map.has("exposures")) design.exposures = map.numbers("exposures", 0, kExposure);
  if (map.has("carrier_px")) design.carrier_px = map.number("carrier_px", kPeriod);
  if (!design.periods_px.empty() || !design.product_periods_px.empty() || design.micro_period_px > 0 ||
      design.modulated_period_px > 0)
    design.steps = map.integer("steps", {3, 64});
  design.gray = map.choice_or("gray", GrayCode::none);
  design.gray_cell_px = map.has("gray_cell_px") ? map.number("gray_cell_px", kCell) : 0;
  design.gray_inverted = map.boolean_or("gray_inverted", false);
  if (map.has("gray_xor_px")) design.gray_xor_px = read_stripes(map);
  design.gray_long_runs = map.boolean_or("gray_long_runs", false);
  design.white_black = map.boolean_or("white_black", false);
  design.bits = map.integer_or("bits", 8, {0, 16});
  design.dithered = map.boolean_or("dithered", false);
  if (design.dithered && design.bits == 0) throw map.error("dithered", "dithering needs a bit depth; bits is 0");
  return design;
}

PatternSequence read_patterns(const std::filesystem::path& file) { return read_patterns(YamlMap::load(file)); }

PatternSequence read_patterns(const YamlMap& map) {
  PatternSequence sequence{map.integer("width_px", kPixels), map.integer("height_px", kPixels), {}};
  for (const YamlMap& entry : map.maps("patterns")) {
    sequence.patterns.push_back(read_pattern(entry));
  }
  if (sequence.patterns.empty())
    throw map.error("patterns", "'patterns' is empty; a sequence needs at least three images");
  if (map.has("inverse_response")) sequence.inverse_response = map.numbers("inverse_response", 0, kFraction);
  map.finish();
  return sequence;
}

std::string to_yaml(const PatternSequence& sequence) {
  std::string text = "width_px: " + std::to_string(sequence.width) + "\nheight_px: " + std::to_string(sequence.height) +
                     "\npatterns:\n";
  for (const Pattern& p : sequence.patterns) text += "  - {" + pattern_entry(p) + "}\n";
  if (!sequence.inverse_response.empty()) text += "inverse_response: " + list(sequence.inverse_response) + "\n";
  return text;
}

RigModel with_calibration(RigModel rig, const RigModel& calibration) {
  const auto require_size = [](const char* device, const Pinhole& images, const Pinhole& calibrated) {
    if (images.width != calibrated.width || images.height != calibrated.height)
      throw Error("the calibration is for a " + std::string(device) + " of " + std::to_string(calibrated.width) + "x" +
                  std::to_string(calibrated.height) + " px, but this one has " + std::to_string(images.width) + "x" +
                  std::to_string(images.height) + " px");
  };
  require_size("camera", rig.camera, calibration.camera);
  require_size("projector", rig.projector, calibration.projector);
  rig.calibrated = calibration.calibrated;
  rig.camera = calibration.camera;
  rig.projector = calibration.projector;
  rig.projector_from_camera = calibration.projector_from_camera;
  if (!calibration.projector_response.empty() || !calibration.phase_correction.offset_rad.empty()) {
    rig.projector_response = calibration.projector_response;
    rig.phase_correction = calibration.phase_correction;
  }
  return rig;
}

}  // namespace fringeslam

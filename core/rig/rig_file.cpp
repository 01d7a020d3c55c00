// SPDX-License-Identifier: Apache-2.0
#include "core/rig/rig_file.h"

#include <Eigen/Geometry>

#include "core/rig/yaml.h"

namespace fringeslam {

namespace {

constexpr Range kPixels{1, 16384};
constexpr Range kFocal{1, 1e6};
constexpr Range kCentre{-1e5, 1e5};

// Whether the lens maps the ray of this pixel, and those between it and the axis, one to one: the distorted radius
// must grow all the way to it.
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

Pinhole read_pinhole(const YamlMap& map) {
  Pinhole p;
  p.width = map.integer("width_px", kPixels);
  p.height = map.integer("height_px", kPixels);
  p.fx = map.number("fx_px", kFocal);
  p.fy = map.number("fy_px", kFocal);
  p.cx = map.number("cx_px", kCentre);
  p.cy = map.number("cy_px", kCentre);
  if (map.has("distortion")) {
    const std::vector<double> d = map.numbers("distortion", 5, {-10, 10});
    p.distortion = {d[0], d[1], d[2], d[3], d[4]};
  }
  for (const double u : {-0.5, p.width - 0.5}) {
    for (const double v : {-0.5, p.height - 0.5}) {
      if (!distortion_is_monotonic(p, {u, v}))
        throw map.error("distortion", "the distortion cannot be inverted at the image corners; check its coefficients");
    }
  }
  return p;
}

SensorModel read_sensor(const YamlMap& map) {
  SensorModel s;
  s.bits = map.integer("bits", {8, 16});
  s.gain_dn_per_electron = map.number("gain_dn_per_electron", {1e-6, 1e3});
  s.dark_noise_electrons = map.number("dark_noise_electrons", {0, 1e5});
  s.full_well_electrons = map.number("full_well_electrons", {1, 1e9});
  s.offset_dn = map.number("offset_dn", {0, 0.5 * s.max_dn()});
  return s;
}

std::string list(std::initializer_list<double> values) {
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

std::string pose_lines(const Pose& p) {
  const Eigen::Matrix3d& r = p.rotation;
  return "  translation_m: " + list({p.translation.x(), p.translation.y(), p.translation.z()}) +
         "\n  rotation_matrix: " +
         list({r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)}) + "\n";
}

}  // namespace

bool beam_meets_view(const RigModel& rig) {
  constexpr int kGrid = 16;
  for (int k = 0; k < kGrid; ++k) {
    const double z = rig.near_m + (rig.far_m - rig.near_m) * k / (kGrid - 1);
    for (int i = 0; i < kGrid; ++i) {
      for (int j = 0; j < kGrid; ++j) {
        const Eigen::Vector2d pixel(rig.camera.width * (i + 0.5) / kGrid, rig.camera.height * (j + 0.5) / kGrid);
        const Eigen::Vector3d in_camera = z * Eigen::Vector3d(rig.camera.undistort(pixel).homogeneous());
        const Eigen::Vector3d point = rig.projector_from_camera * in_camera;
        if (point.z() > 0 && rig.projector.contains(rig.projector.project(point))) return true;
      }
    }
  }
  return false;
}

RigModel read_rig(const YamlMap& map) {
  RigModel rig;
  rig.name = map.text("name");
  rig.near_m = map.number("near_m", {0.01, 100});
  rig.far_m = map.number("far_m", {0.01, 100});
  if (rig.far_m <= rig.near_m) throw map.error("far_m", "far_m must be larger than near_m");
  const YamlMap camera = map.map("camera");
  rig.camera = read_pinhole(camera);
  rig.sensor = read_sensor(camera.map("sensor"));
  const YamlMap projector = map.map("projector");
  rig.projector = read_pinhole(projector);
  rig.white_electrons_at_1m = projector.number("white_electrons_at_1m", {1, 1e9});
  rig.projector_black_level = projector.number("black_level", {0, 0.5});
  rig.projector_from_camera = map.pose("projector_from_camera");
  rig.robot_from_camera = map.pose("robot_from_camera");
  if (translation_m(rig.projector_from_camera) < 1e-3)
    throw map.error("projector_from_camera", "camera and projector stand in one place: no depth can be triangulated");
  if (!beam_meets_view(rig))
    throw map.error("projector_from_camera",
                    "the projector lights nothing that the camera sees between near_m and far_m; turn or move it");
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
  return "name: " + yaml_quoted(rig.name) + "\nnear_m: " + to_text(rig.near_m) + "\nfar_m: " + to_text(rig.far_m) +
         "\ncamera:\n" + pinhole_lines(rig.camera) + "  sensor:\n    bits: " + std::to_string(s.bits) +
         "\n    gain_dn_per_electron: " + to_text(s.gain_dn_per_electron) +
         "\n    dark_noise_electrons: " + to_text(s.dark_noise_electrons) +
         "\n    full_well_electrons: " + to_text(s.full_well_electrons) + "\n    offset_dn: " + to_text(s.offset_dn) +
         "\nprojector:\n" + pinhole_lines(rig.projector) +
         "  white_electrons_at_1m: " + to_text(rig.white_electrons_at_1m) +
         "\n  black_level: " + to_text(rig.projector_black_level) + "\nprojector_from_camera:\n" +
         pose_lines(rig.projector_from_camera) + "robot_from_camera:\n" + pose_lines(rig.robot_from_camera);
}

PatternSequence read_patterns(const std::filesystem::path& file) {
  const YamlMap map = YamlMap::load(file);
  PatternSequence sequence{map.integer("width_px", kPixels), map.integer("height_px", kPixels), {}};
  for (const YamlMap& entry : map.maps("patterns")) {
    Pattern pattern;
    pattern.axis = entry.choice("axis", {"columns", "rows"}) == "columns" ? Axis::columns : Axis::rows;
    pattern.period_px = entry.number("period_px", {2, 1e5});
    pattern.shift_rad = entry.number("shift_rad", {-1e3, 1e3});
    pattern.bits = entry.integer("bits", {0, 16});
    sequence.patterns.push_back(pattern);
  }
  if (sequence.patterns.empty())
    throw map.error("patterns", "'patterns' is empty; a sequence needs three images or more");
  map.finish();
  return sequence;
}

std::string to_yaml(const PatternSequence& sequence) {
  std::string text = "width_px: " + std::to_string(sequence.width) + "\nheight_px: " + std::to_string(sequence.height) +
                     "\npatterns:\n";
  for (const Pattern& p : sequence.patterns) {
    text += std::string("  - {axis: ") + (p.axis == Axis::columns ? "columns" : "rows") +
            ", period_px: " + to_text(p.period_px) + ", shift_rad: " + to_text(p.shift_rad) +
            ", bits: " + std::to_string(p.bits) + "}\n";
  }
  return text;
}

}  // namespace fringeslam

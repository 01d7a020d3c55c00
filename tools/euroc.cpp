// SPDX-License-Identifier: Apache-2.0
#include "tools/euroc.h"

#include <cinttypes>
#include <cstdio>

#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "tools/bag/bag_dataset.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

std::string digits(BagTime time) {
  char text[32];
  std::snprintf(text, sizeof text, "%019" PRId64, time);
  return text;
}

constexpr const char* kIdentity =
    "T_BS:\n  cols: 4\n  rows: 4\n"
    "  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\n";

// EuRoC's cameras have four distortion coefficients; k3 follows them if it is not 0.
std::string sensor_yaml(const std::string& type, const std::string& comment, const Pinhole& lens, double rate_hz,
                        const std::string& more) {
  const Distortion& d = lens.distortion;
  std::string coefficients = to_text(d.k1) + ", " + to_text(d.k2) + ", " + to_text(d.p1) + ", " + to_text(d.p2);
  if (d.k3 != 0) coefficients += ", " + to_text(d.k3);
  return "sensor_type: " + type + "\ncomment: " + comment + "\n" + kIdentity + "rate_hz: " + to_text(rate_hz) +
         "\nresolution: [" + std::to_string(lens.width) + ", " + std::to_string(lens.height) +
         "]\ncamera_model: pinhole\nintrinsics: [" + to_text(lens.fx) + ", " + to_text(lens.fy) + ", " +
         to_text(lens.cx) + ", " + to_text(lens.cy) + "]\ndistortion_model: radial-tangential\n" +
         "distortion_coefficients: [" + coefficients + "]\n" + more;
}

// `camera` has capture times.
void write_truth(const fs::path& folder, const Trajectory& camera, double offset_s) {
  std::string text =
      "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n";
  for (const TimedPose& pose : camera) {
    const Eigen::Vector3d& t = pose.world_from_robot.translation;
    const Eigen::Vector4d q = quaternion_xyzw(pose.world_from_robot.rotation);
    text += digits(bag_time(pose.timestamp_s, offset_s));
    for (const double value : {t.x(), t.y(), t.z(), q[3], q[0], q[1], q[2]}) text += "," + to_text(value);
    text += "\n";
  }
  fs::create_directories(folder);
  write_text(folder / "data.csv", text);
  write_text(folder / "sensor.yaml", std::string("sensor_type: pose\ncomment: true pose of the camera\n") + kIdentity);
}

}  // namespace

WrittenViews write_euroc(Source& source, const Settings& settings, const RgbdOptions& options, bool with_truth,
                         const fs::path& out, const Common& common) {
  prepare(source, options, out.string());
  StagedFolder folder(out, "euroc");
  const fs::path mav = folder.path() / "mav0", texture = mav / "cam0", depth = mav / "depth0";
  for (const fs::path& sensor : {texture, depth}) fs::create_directories(sensor / "data");
  std::string list = "#timestamp [ns],filename\n";
  std::optional<double> offset_s;
  double first_s = 0, last_s = 0;
  WrittenViews written;
  const auto write = [&](const RgbdView& view) {
    last_s = view.stack.timestamp_s;
    if (!offset_s) offset_s = clock_offset_s(first_s = last_s);
    const std::string time = digits(bag_time(last_s, *offset_s)), name = time + ".png";
    if (fs::exists(texture / "data" / name)) throw Error(out.string() + ": two views have the same timestamp");
    write_png(texture / "data" / name, view.frame.texture);
    write_png(depth / "data" / name, depth_units(view.depth_m, options.units_per_m));
    list += time + "," + name + "\n";
    ++written.views;
  };
  written.robot = for_each_view(source, settings, options, folder.path(), out.string(), common, write);
  const RigModel& model = source.model();
  const double rate_hz = last_s > first_s ? (written.views - 1) / (last_s - first_s) : 1;
  for (const fs::path& sensor : {texture, depth}) write_text(sensor / "data.csv", list);
  write_text(texture / "sensor.yaml", sensor_yaml("camera", "texture without fringes", model.camera, rate_hz, ""));
  write_text(depth / "sensor.yaml", sensor_yaml("depth", "z, 0 where there is none", model.camera, rate_hz,
                                                "units_per_m: " + to_text(options.units_per_m) + "\n"));
  write_text(mav / "body.yaml", "comment: the body is the camera of cam0\n");
  if (with_truth && source.has_truth())
    write_truth((folder.path() / kEurocTruthFile).parent_path(), camera_trajectory(written.robot, model), *offset_s);
  for (TimedPose& pose : written.robot) pose.timestamp_s += *offset_s;
  write_text(folder.path() / "rig.yaml", to_yaml(model));
  folder.commit();
  return written;
}

}  // namespace fringeslam::tools

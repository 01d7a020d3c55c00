// SPDX-License-Identifier: Apache-2.0
#include "tools/tum_rgbd.h"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/tum_file.h"
#include "core/rig/rig_file.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

// Formats a timestamp as the benchmark does.
std::string time_text(double timestamp_s) {
  char text[64];
  std::snprintf(text, sizeof text, "%.6f", timestamp_s);
  return text;
}

// Pads the time to the width of times since 1970, because some readers sort by name.
std::string image_name(double timestamp_s) {
  char text[64];
  std::snprintf(text, sizeof text, "%017.6f.png", timestamp_s);
  return text;
}

// Returns the mean frame rate between the first and the last frame.
double rate_hz(const Trajectory& times) {
  const double seconds = times.back().timestamp_s - times.front().timestamp_s;
  return seconds > 0 ? static_cast<double>(times.size() - 1) / seconds : 1;
}

// Keypoint and viewer settings as in ORB-SLAM3's own examples; the others describe this sensor. `b` and `ThDepth`
// determine up to which depth points count as near: over the whole working range.
std::string orb_slam_settings(const RigModel& rig, double units_per_m, double rate_hz) {
  const Pinhole& c = rig.camera;
  const Distortion& d = c.distortion;
  const double baseline_m = rig.projector_from_camera.inverse().translation.norm();
  const std::vector<std::pair<const char*, double>> values = {
      {"Camera1.fx", c.fx}, {"Camera1.fy", c.fy}, {"Camera1.cx", c.cx}, {"Camera1.cy", c.cy}, {"Camera1.k1", d.k1},
      {"Camera1.k2", d.k2}, {"Camera1.p1", d.p1}, {"Camera1.p2", d.p2}, {"Camera1.k3", d.k3}};
  // OpenCV reads a number without a decimal point as an integer, which ORB-SLAM3 then refuses.
  const auto real = [](double value) {
    const std::string text = to_text(value);
    return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
  };
  std::string text = "%YAML:1.0\nFile.version: \"1.0\"\nCamera.type: \"PinHole\"\n";
  for (const auto& [key, value] : values) text += std::string(key) + ": " + real(value) + "\n";
  text += "Camera.width: " + std::to_string(c.width) + "\nCamera.height: " + std::to_string(c.height) + "\n";
  text += "Camera.fps: " + std::to_string(std::max(1, static_cast<int>(std::lround(rate_hz)))) + "\nCamera.RGB: 1\n";
  text += "Stereo.b: " + real(baseline_m) + "\nStereo.ThDepth: " + real(std::ceil(2 * rig.far_m / baseline_m)) + "\n";
  text += "RGBD.DepthMapFactor: " + real(units_per_m) + "\n";
  return text +
         "ORBextractor.nFeatures: 1000\nORBextractor.scaleFactor: 1.2\nORBextractor.nLevels: 8\n"
         "ORBextractor.iniThFAST: 20\nORBextractor.minThFAST: 7\nViewer.KeyFrameSize: 0.05\n"
         "Viewer.KeyFrameLineWidth: 1.0\nViewer.GraphLineWidth: 0.9\nViewer.PointSize: 2.0\nViewer.CameraSize: 0.08\n"
         "Viewer.CameraLineWidth: 3.0\nViewer.ViewpointX: 0.0\nViewer.ViewpointY: -0.7\nViewer.ViewpointZ: -1.8\n"
         "Viewer.ViewpointF: 500.0\n";
}

// Open3D stores the matrix column by column.
std::string open3d_intrinsic(const Pinhole& c) {
  const nlohmann::ordered_json json = {
      {"width", c.width}, {"height", c.height}, {"intrinsic_matrix", {c.fx, 0, 0, 0, c.fy, 0, c.cx, c.cy, 1}}};
  return json_text(json, 2) + "\n";
}

// The image lists of a folder. Like the benchmark's, rgb.txt and depth.txt begin with three comment lines, which some
// readers skip.
struct Lists {
  std::string rgb = "# texture images\n#\n# timestamp filename\n", depth = "# depth images\n#\n# timestamp filename\n",
              both;

  void add(const std::string& time, const std::string& name) {
    rgb += time + " rgb/" + name + "\n";
    depth += time + " depth/" + name + "\n";
    both += time + " rgb/" + name + " " + time + " depth/" + name + "\n";
  }
};

}  // namespace

void write_camera_truth(const fs::path& file, const Trajectory& camera) {
  write_text(file,
             "# true trajectory of the camera: x right, y down, z forward\n#\n# timestamp tx ty tz qx qy qz qw\n" +
                 to_tum(camera));
}

int write_tum_rgbd(Source& source, const Settings& settings, const RgbdOptions& options, const fs::path& out,
                   const Common& common) {
  prepare(source, options, out.string());
  StagedFolder folder(out, "tum-rgbd");
  for (const char* name : {"rgb", "depth"}) fs::create_directory(folder.path() / name);
  Lists lists;
  Trajectory seen;
  std::string last;
  const auto write = [&](const RgbdView& view) {
    const double time_s = view.stack.timestamp_s;
    const std::string time = time_text(time_s), name = image_name(time_s);
    if (time == last)
      throw Error(out.string() +
                  ": two views have the same timestamp in microseconds, which the format cannot distinguish");
    last = time;
    cv::Mat texture;
    cv::cvtColor(view.frame.texture, texture, cv::COLOR_GRAY2BGR);
    write_png(folder.path() / "rgb" / name, texture);
    write_png(folder.path() / "depth" / name, depth_units(view.depth_m, options.units_per_m));
    lists.add(time, name);
    seen.push_back({time_s, {}});
  };
  const Trajectory robot = for_each_view(source, settings, options, folder.path(), out.string(), common, write);
  if (seen.empty()) throw Error(out.string() + ": the source contains no views");
  const RigModel& model = source.model();
  if (source.has_truth()) write_camera_truth(folder.path() / kTumTruthFile, camera_trajectory(robot, model));
  write_text(folder.path() / "rgb.txt", lists.rgb);
  write_text(folder.path() / "depth.txt", lists.depth);
  write_text(folder.path() / "associations.txt", lists.both);
  write_text(folder.path() / "camera.yaml", orb_slam_settings(model, options.units_per_m, rate_hz(seen)));
  write_text(folder.path() / "intrinsic.json", open3d_intrinsic(model.camera));
  write_text(folder.path() / "rig.yaml", to_yaml(model));
  folder.commit();
  return static_cast<int>(seen.size());
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "tools/report/report_data.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/base/parallel.h"
#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/tum_file.h"
#include "core/io/yaml.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/score/score.h"
#include "core/score/truth_files.h"
#include "tools/report/map_error.h"
#include "tools/report/packing.h"
#include "tools/report/simplify_mesh.h"
#include "tools/report/view_pictures.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

namespace {

constexpr double kOutlineTolerancePx = 0.7;

ordered_json read_json(const fs::path& file) {
  ordered_json json = ordered_json::parse(read_input(file, kMostDataBytes), nullptr, false);
  if (json.is_discarded()) throw Error(file.string() + ": is not JSON, or truncated");
  return json;
}

ordered_json json_of(const Pose& pose) {
  const Eigen::Vector3d& t = pose.translation;
  const Eigen::Vector4d q = quaternion_xyzw(pose.rotation);
  return {{"position", {t.x(), t.y(), t.z()}}, {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
}

ordered_json json_of(const SixDof& six) {
  const Eigen::Vector3d &t = six.translation_mm, &a = six.angles_deg;
  return {t.x(), t.y(), t.z(), a.x(), a.y(), a.z()};
}

// Returns null for an empty optional; NaN is serialized as null anyway.
ordered_json median_of(const ordered_json& list, const char* key) {
  std::vector<double> values;
  for (const auto& entry : list) {
    if (entry.at(key).is_number()) values.push_back(entry.at(key));
  }
  return values.empty() ? ordered_json() : ordered_json(fringeslam::median_of(values));
}

// Estimated and true poses of a view, in the map's frame.
struct Located {
  std::optional<Pose> robot, true_robot;
  std::optional<double> time_s;
};

// The contents of a run folder.
class Collector {
 public:
  Collector(fs::path folder, const ReportLimits& limits);
  ordered_json collect();

 private:
  void locate();
  void read_map();
  void compare_views();
  ViewImages read_images(size_t view, TruthFrame* truth) const;
  ordered_json rig_json() const;
  ordered_json view_json(size_t view) const;
  ordered_json summary() const;
  ordered_json motions() const;
  ordered_json landmarks_of(int index) const;
  ordered_json map_json() const;

  fs::path folder_;
  ReportLimits limits_;
  YamlMap config_;
  RigModel rig_;
  ordered_json frames_, landmarks_, score_;                     // as written; score_ is null without ground truth
  ordered_json warm_;                                           // victims.json; null without a thermal camera
  std::map<int, const ordered_json*> score_of_, landmarks_of_;  // entries of score_ and landmarks_ by view index
  std::vector<int> indices_;                                    // of the views
  std::vector<Located> located_;
  bool has_truth_ = false;
  SimplifiedMesh map_;
  std::vector<float> map_errors_m_;
  size_t every_ = 1;
  PictureScales scales_;
  std::vector<ordered_json> views_;
  int picture_width_ = 0;
};

Collector::Collector(fs::path folder, const ReportLimits& limits)
    : folder_(std::move(folder)), limits_(limits), config_([&] {
        if (!fs::exists(folder_ / "frames.json"))
          throw Error(folder_.string() + ": is not a run: it contains no frames.json");
        return YamlMap::load(folder_ / "config.yaml");
      }()) {
  rig_ = read_rig(folder_ / "rig.yaml");
  frames_ = read_json(folder_ / "frames.json");
  if (fs::exists(folder_ / "landmarks.json")) landmarks_ = read_json(folder_ / "landmarks.json");
  if (fs::exists(folder_ / "victims.json")) warm_ = read_json(folder_ / "victims.json");
  if (fs::exists(folder_ / "score.json")) score_ = read_json(folder_ / "score.json");
  has_truth_ = !score_.is_null() && fs::exists(folder_ / "truth" / "truth.tum");
  for (const auto& frame : frames_) indices_.push_back(frame.at("index"));
  if (score_.contains("frames")) {
    for (const auto& frame : score_["frames"]) score_of_[frame.at("index")] = &frame;
  }
  for (const auto& view : landmarks_) landmarks_of_[view.at("index")] = &view;
}

// trajectory.tum contains a pose for each tracked view, in their order; truth.tum one for each stack.
void Collector::locate() {
  located_.resize(indices_.size());
  std::vector<size_t> tracked;
  for (size_t v = 0; v < indices_.size(); ++v) {
    if (frames_[v].at("tracking") != "lost" && frames_[v].at("tracking") != "ambiguous") tracked.push_back(v);
  }
  Trajectory trajectory;
  if (!tracked.empty()) trajectory = read_tum(folder_ / "trajectory.tum");
  if (trajectory.size() != tracked.size())
    throw Error((folder_ / "trajectory.tum").string() + ": holds " + std::to_string(trajectory.size()) +
                " poses, but " + std::to_string(tracked.size()) + " views of frames.json were tracked");
  for (size_t i = 0; i < tracked.size(); ++i)
    located_[tracked[i]] = {trajectory[i].world_from_robot, {}, trajectory[i].timestamp_s};
  if (!has_truth_ || tracked.empty()) return;
  const Trajectory truth = read_tum(folder_ / "truth" / "truth.tum");
  const auto truth_of = [&](size_t view) -> const TimedPose& {
    const auto index = static_cast<size_t>(indices_[view]);
    if (index >= truth.size())
      throw Error((folder_ / "truth" / "truth.tum").string() + ": has no pose of view " + std::to_string(index));
    return truth[index];
  };
  // Same alignment as the trajectory error: the first poses coincide.
  const Pose map_from_truth = *located_[tracked[0]].robot * truth_of(tracked[0]).world_from_robot.inverse();
  for (size_t v = 0; v < indices_.size(); ++v) {
    located_[v].true_robot = map_from_truth * truth_of(v).world_from_robot;
    located_[v].time_s = truth_of(v).timestamp_s;
  }
}

void Collector::read_map() {
  // The fused surface or, if it is missing or empty, the cloud.
  for (const char* name : {"mesh.ply", "map.ply"}) {
    if (!map_.mesh.vertices.empty() || !fs::exists(folder_ / name)) continue;
    map_ = thinned(folder_ / name, limits_.vertices);
  }
}

// Reads a view's pictures and, if `truth` is wanted, its ground truth, and compares both.
ViewImages Collector::read_images(size_t view, TruthFrame* truth) const {
  const fs::path folder = folder_ / "frames" / stack_name(indices_[view]);
  ViewImages images{indices_[view],
                    read_grey(folder / "texture.png"),
                    read_depth_estimate(folder / "depth.exr", &rig_.camera).depth_m,
                    {}};
  if (images.texture.size() != images.depth_m.size() || images.texture.type() != CV_8UC1)
    throw Error((folder / "texture.png").string() + ": does not have 8 bits and the size of depth.exr");
  if (rig_.thermal && fs::exists(folder / "temperature.exr"))
    images.temperature_c = read_grey(folder / "temperature.exr");
  if (!truth) return images;
  const fs::path file = folder_ / "truth" / (stack_name(indices_[view]) + ".exr");
  *truth = read_truth_frame(file, &rig_.camera);
  if (truth->depth_m.size() != images.depth_m.size())
    throw Error(file.string() + ": does not have the size of the view's depth.exr");
  cv::subtract(images.depth_m, truth->depth_m, images.error_m);
  return images;
}

void Collector::compare_views() {
  every_ = std::max<size_t>(1, (indices_.size() + static_cast<size_t>(limits_.pictured_views) - 1) /
                                   static_cast<size_t>(limits_.pictured_views));
  for (size_t v = 0; v < indices_.size(); ++v) views_.push_back(view_json(v));
  MapError map_error(map_.mesh.vertices, rig_);
  std::vector<ViewImages> pictured((indices_.size() + every_ - 1) / every_);
  // Reading takes most of the time. The map's errors are collected in the order of the views.
  constexpr size_t kAtOnce = 8;
  std::array<TruthFrame, kAtOnce> truths;
  for (size_t first = 0; first < pictured.size(); first += kAtOnce) {
    const size_t count = std::min(kAtOnce, pictured.size() - first);
    for_each_row(static_cast<int>(count), [&](int i) {
      const size_t at = first + static_cast<size_t>(i);
      TruthFrame* truth = has_truth_ ? &truths[static_cast<size_t>(i)] : nullptr;
      pictured[at] = shrunk(read_images(at * every_, truth), limits_.picture_width_px);
    });
    for (size_t i = 0; has_truth_ && i < count; ++i) {
      const Located& located = located_[(first + i) * every_];
      if (located.robot) map_error.add(truths[i], *located.true_robot * rig_.robot_from_camera);
    }
  }
  map_errors_m_ = map_error.distances_m();
  scales_ = picture_scales(pictured);
  const std::vector<ordered_json> pictures = encoded(pictured, scales_, limits_.picture_bytes);
  for (size_t i = 0; i < pictures.size(); ++i) {
    views_[i * every_]["pictures"] = pictures[i];
    views_[i * every_]["landmarks"] = landmarks_of(indices_[i * every_]);
    picture_width_ = pictures[i].at("width");
  }
}

ordered_json Collector::rig_json() const {
  const Pinhole& camera = rig_.camera;
  ordered_json corners = ordered_json::array();
  const double right = camera.width - 0.5, below = camera.height - 0.5;
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(-0.5, -0.5), Eigen::Vector2d(right, -0.5),
                                       Eigen::Vector2d(right, below), Eigen::Vector2d(-0.5, below)}) {
    const Eigen::Vector2d slope = camera.undistort(pixel);
    corners.push_back({slope.x(), slope.y()});
  }
  return {{"name", rig_.name},        {"near_m", rig_.near_m},      {"far_m", rig_.far_m},
          {"width_px", camera.width}, {"height_px", camera.height}, {"corners", corners}};
}

ordered_json Collector::view_json(size_t view) const {
  ordered_json json = frames_[view];
  const Located& located = located_[view];
  const double pixels = static_cast<double>(rig_.camera.width) * rig_.camera.height;
  json["valid_share"] = json.at("valid_pixels").get<double>() / pixels;
  json["time_s"] = located.time_s ? ordered_json(*located.time_s) : ordered_json();
  json["pose"] = located.robot ? json_of(*located.robot * rig_.robot_from_camera) : ordered_json();
  json["true_pose"] = located.true_robot ? json_of(*located.true_robot * rig_.robot_from_camera) : ordered_json();
  json["position_error_mm"] = nullptr;
  if (located.robot && located.true_robot)
    json["position_error_mm"] = 1e3 * (located.robot->translation - located.true_robot->translation).norm();
  if (!json.contains("sigma_mm")) json["sigma_mm"] = nullptr;
  const auto score = score_of_.find(indices_[view]);
  json["score"] = score == score_of_.end() ? ordered_json() : *score->second;
  json["pictures"] = nullptr;
  json["landmarks"] = nullptr;
  return json;
}

ordered_json Collector::landmarks_of(int index) const {
  ordered_json list = ordered_json::array();
  const auto view = landmarks_of_.find(index);
  if (view == landmarks_of_.end()) return list;
  for (const auto& landmark : view->second->at("landmarks")) {
    std::vector<cv::Point> outline, simple;
    for (const auto& point : landmark.at("outline_px")) outline.emplace_back(point.at(0), point.at(1));
    if (outline.size() < 3) continue;
    cv::approxPolyDP(outline, simple, kOutlineTolerancePx, true);
    ordered_json numbers = ordered_json::array();
    for (const cv::Point& point : simple) numbers.insert(numbers.end(), {point.x, point.y});
    list.push_back({{"outline", numbers}, {"recognised", landmark.contains("recognised")}});
  }
  return list;
}

ordered_json Collector::motions() const {
  if (score_.contains("pairs")) return score_["pairs"];
  ordered_json pairs = ordered_json::array();
  std::optional<size_t> previous;
  for (size_t v = 0; v < located_.size(); ++v) {
    if (!located_[v].robot) continue;
    if (previous)
      pairs.push_back({{"previous", indices_[*previous]},
                       {"current", indices_[v]},
                       {"estimated", json_of(six_dof(located_[*previous].robot->inverse() * *located_[v].robot))}});
    previous = v;
  }
  return pairs;
}

ordered_json Collector::summary() const {
  int tracked = 0;
  for (const Located& located : located_) tracked += located.robot.has_value();
  ordered_json json = {{"views", indices_.size()}, {"tracked", tracked}};
  json["ate_mm"] = json["translation_mm"] = json["rotation_deg"] = json["error_over_bound"] = json["depth_mm"] =
      nullptr;
  if (score_.contains("pairs")) {
    json["ate_mm"] = score_.at("trajectory").at("ate_rmse_mm");
    json["translation_mm"] = median_of(score_["pairs"], "translation_error_mm");
    json["rotation_deg"] = median_of(score_["pairs"], "rotation_error_deg");
    json["error_over_bound"] = median_of(score_["pairs"], "error_over_bound");
  }
  if (score_.contains("frames")) json["depth_mm"] = median_of(score_["frames"], "depth_median_mm");
  return json;
}

ordered_json Collector::map_json() const {
  const std::vector<CloudPoint>& vertices = map_.mesh.vertices;
  if (vertices.empty()) return nullptr;
  Eigen::Vector3f low = vertices.front().position_m, high = low;
  for (const CloudPoint& vertex : vertices) {
    low = low.cwiseMin(vertex.position_m);
    high = high.cwiseMax(vertex.position_m);
  }
  const double step_m = std::max(1e-9, static_cast<double>((high - low).maxCoeff()) / 65535);
  std::vector<uint16_t> planes[3];
  std::vector<uint8_t> grey;
  for (const CloudPoint& vertex : vertices) {
    for (int i = 0; i < 3; ++i)
      planes[i].push_back(static_cast<uint16_t>(std::lround((vertex.position_m[i] - low[i]) / step_m)));
    grey.push_back(vertex.grey);
  }
  std::vector<uint32_t> indices;
  for (const auto& triangle : map_.mesh.triangles) indices.insert(indices.end(), triangle.begin(), triangle.end());
  ordered_json json = {{"vertices", vertices.size()},
                       {"triangles", map_.mesh.triangles.size()},
                       {"whole_vertices", map_.whole_vertices},
                       {"whole_triangles", map_.whole_triangles},
                       {"cell_mm", map_.cell_m * 1e3},
                       {"origin", {low.x(), low.y(), low.z()}},
                       {"step_m", step_m},
                       {"white", scales_.white},
                       {"x", packed(planes[0])},
                       {"y", packed(planes[1])},
                       {"z", packed(planes[2])},
                       {"grey", packed(grey)},
                       {"indices", packed(indices)},
                       {"error", nullptr},
                       {"error_limit_mm", nullptr}};
  const double limit_m = error_limit_m(map_errors_m_);
  if (limit_m == 0) return json;
  const cv::Mat1f errors(1, static_cast<int>(map_errors_m_.size()), const_cast<float*>(map_errors_m_.data()));
  const cv::Mat1b shown = levels(errors, -limit_m, limit_m);
  json["error"] = packed(std::vector<uint8_t>(shown.begin(), shown.end()));
  json["error_limit_mm"] = limit_m * 1e3;
  return json;
}

ordered_json Collector::collect() {
  locate();
  read_map();
  compare_views();
  ordered_json json = {{"version", FRINGESLAM_VERSION},
                       {"name", config_.text("name")},
                       {"seed", std::to_string(config_.seed("seed"))},  // JavaScript's numbers end at 2^53
                       {"has_truth", has_truth_},
                       {"rig", rig_json()},
                       {"summary", summary()},
                       {"views", views_},
                       {"motions", motions()}};
  json["pictures"] = {
      {"near_m", scales_.near_m},  {"far_m", scales_.far_m},   {"error_limit_mm", scales_.error_limit_m * 1e3},
      {"cold_c", scales_.cold_c},  {"warm_c", scales_.warm_c}, {"every", every_},
      {"width_px", picture_width_}};
  json["map"] = map_json();
  json["warm_things"] = warm_;
  for (auto& thing : json["warm_things"]) thing.erase("points_m");
  return json;
}

}  // namespace

ordered_json report_data(const fs::path& run, const ReportLimits& limits) {
  try {
    return Collector(run, limits).collect();
  } catch (const nlohmann::json::exception& e) {
    throw Error(run.string() + ": frames.json, landmarks.json or score.json is not in a run's format: " + e.what());
  }
}

}  // namespace fringeslam::tools

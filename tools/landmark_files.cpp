// SPDX-License-Identifier: Apache-2.0
#include "tools/landmark_files.h"

#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

namespace fringeslam::tools {

std::string keypoint_table(const Landmarks& landmarks) {
  std::string text = "keypoint,x_px,y_px,depth_level,scale_px,orientation_rad,cluster,order,connections,samples\n";
  char line[256];
  for (size_t i = 0; i < landmarks.depth_keypoints.size(); ++i) {
    const DepthKeypoint& k = landmarks.depth_keypoints[i];
    std::snprintf(line, sizeof line, "%zu,%.2f,%.2f,%d,%.2f,%.3f,", i + 1, k.pixel.x(), k.pixel.y(), k.level, k.scale,
                  k.angle_rad);
    text += line;
    if (k.cluster < 0) {
      text += ",,,\n";
      continue;
    }
    std::snprintf(line, sizeof line, "%d,%d,%d,", k.cluster + 1, k.order + 1, k.connections);
    text += line;
    for (size_t s = 0; s < k.samples.size(); ++s) text += (s ? " " : "") + std::to_string(k.samples[s]);
    text += '\n';
  }
  return text;
}

namespace {

// Rounds to 0.001 of the unit; smaller digits are not significant.
double rounded(double value) { return std::round(1e3 * value) / 1e3; }

nlohmann::ordered_json to_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

nlohmann::ordered_json to_json(const WarmRegion& region) {
  return {{"kind", to_string(region.kind)},
          {"candidate", region.candidate()},
          {"reason", region.reason},
          {"warmest_c", rounded(region.warmest_c)},
          {"mean_c", rounded(region.mean_c)},
          {"max_c", rounded(region.max_c)},
          {"spread_c", rounded(region.spread_c)},
          {"area_cm2", rounded(1e4 * region.area_m2)},
          {"planar_share", rounded(region.planar_share)},
          {"pipe_share", rounded(region.pipe.share)},
          {"pixels", region.pixels},
          {"centre_m", to_json(region.centre_m)},
          {"box_px", {region.box.x, region.box.y, region.box.width, region.box.height}}};
}

nlohmann::ordered_json to_json(const LandmarkTemperature& temperature, const WarmView& warm) {
  bool candidate = false;
  for (const int region : temperature.regions) candidate |= warm.list[static_cast<size_t>(region)].candidate();
  return {{"mean_c", rounded(temperature.mean_c)},
          {"max_c", rounded(temperature.max_c)},
          {"p95_c", rounded(temperature.p95_c)},
          {"spread_c", rounded(temperature.spread_c)},
          {"warm_share", rounded(temperature.warm_share)},
          {"warm_regions", temperature.regions},
          {"victim_candidate", candidate}};
}

}  // namespace

nlohmann::ordered_json to_json(const std::vector<WarmObject>& things) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const WarmObject& thing : things) {
    list.push_back({{"victim", thing.victim},
                    {"reason", thing.reason},
                    {"position_m", to_json(thing.position_m)},
                    {"extent_m", rounded(thing.extent_m)},
                    {"warmest_c", rounded(thing.temperature_c)},
                    {"area_cm2", rounded(1e4 * thing.area_m2)},
                    {"skin_share", rounded(thing.skin_share)},
                    {"views", thing.views},
                    {"skin_views", thing.skin_views},
                    {"best_view", thing.best_view},
                    {"best_region", thing.best_region}});
    auto& points = list.back()["points_m"] = nlohmann::ordered_json::array();
    for (const Eigen::Vector3d& p : thing.points_m) points.push_back({rounded(p.x()), rounded(p.y()), rounded(p.z())});
  }
  return list;
}

nlohmann::ordered_json landmarks_json(int index, const FrameResult& view, const ThermalView& thermal) {
  const Landmarks& found = view.landmarks;
  std::map<int, const Recognition*> recognitions;
  for (const Recognition& r : view.recognitions) recognitions[r.landmark] = &r;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (size_t l = 0; l < found.landmarks.size(); ++l) {
    const Landmark& landmark = found.landmarks[l];
    nlohmann::ordered_json outline = nlohmann::ordered_json::array();
    for (const cv::Point& p : landmark.outline) outline.push_back({p.x, p.y});
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const int k : landmark.keypoints) centre += found.keypoints.keypoints[static_cast<size_t>(k)].point_m;
    centre /= static_cast<double>(landmark.keypoints.size());
    nlohmann::ordered_json entry = {{"landmark", l},
                                    {"keypoints", landmark.keypoints.size()},
                                    {"depth_keypoints", landmark.depth_keypoints.size()},
                                    {"centre_m", {centre.x(), centre.y(), centre.z()}},
                                    {"outline_px", outline}};
    if (const auto r = recognitions.find(static_cast<int>(l)); r != recognitions.end())
      entry["recognised"] = {{"keyframe", r->second->earlier_frame},
                             {"landmark", r->second->earlier_landmark},
                             {"matches", r->second->matches.size()}};
    if (l < thermal.landmarks.size() && thermal.landmarks[l].pixels > 0)
      entry["temperature"] = to_json(thermal.landmarks[l], thermal.warm);
    list.push_back(std::move(entry));
  }
  nlohmann::ordered_json json = {{"index", index},
                                 {"texture_keypoints", found.keypoints.keypoints.size()},
                                 {"depth_keypoints", found.depth_keypoints.size()},
                                 {"background_keypoints", found.background_keypoints},
                                 {"dilations", found.dilations},
                                 {"clusters_without_hull", found.without_hull},
                                 {"indistinct", found.indistinct},
                                 {"landmarks", list}};
  if (thermal.temperature_c.empty()) return json;
  json["surroundings_c"] = rounded(thermal.warm.surroundings_c);
  json["warm_regions"] = nlohmann::ordered_json::array();
  for (const WarmRegion& region : thermal.warm.list) json["warm_regions"].push_back(to_json(region));
  return json;
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "tools/landmark_files.h"

#include <cstdio>
#include <map>

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

nlohmann::ordered_json landmarks_json(int index, const FrameResult& view) {
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
    list.push_back(std::move(entry));
  }
  return {{"index", index},
          {"texture_keypoints", found.keypoints.keypoints.size()},
          {"depth_keypoints", found.depth_keypoints.size()},
          {"background_keypoints", found.background_keypoints},
          {"dilations", view.landmark_stages.conditioned.dilations},
          {"clusters_without_hull", found.without_hull},
          {"indistinct", found.indistinct},
          {"landmarks", list}};
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "tools/report/trial_pictures.h"

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/report/view_pictures.h"

namespace fringeslam::tools {

namespace {

using namespace studies;
using nlohmann::ordered_json;

constexpr int kWidth = 266;                    // px: half of [T]'s camera
constexpr size_t kMostViews = 4;               // per trial
constexpr size_t kMostBytes = 60'000 * 2 * 4;  // per trial: only a safeguard for unusual sensors

ViewImages images_of(const FrameResult& result, const TruthFrame& truth) {
  ViewImages images{truth.index, result.frame.texture, {}, {}};
  cv::extractChannel(result.frame.points_m, images.depth_m, 2);
  cv::subtract(images.depth_m, truth.depth_m, images.error_m);
  return shrunk(images, kWidth);
}

// Selects views at even spacing, including the first and the last.
template <class Value>
std::vector<Value> spread(const std::vector<Value>& values, size_t most) {
  if (values.size() <= most) return values;
  std::vector<Value> chosen;
  for (size_t i = 0; i < most; ++i) chosen.push_back(values[i * (values.size() - 1) / (most - 1)]);
  return chosen;
}

struct Seen {
  ViewImages images;
  bool lost = false;
};

}  // namespace

ordered_json trial_pictures(const Study& study, const Trial& trial) {
  std::vector<Seen> seen;
  const TrialResult result = run_trial(study, trial, [&](const FrameResult& frame, const TruthFrame& truth) {
    seen.push_back({images_of(frame, truth), !has_pose(frame.tracking)});
  });
  ordered_json json = {{"trial", trial.index}};
  if (seen.empty()) {
    json["unpictured"] = result.message;
    return json;
  }
  const std::vector<Seen> shown = spread(seen, kMostViews);
  std::vector<ViewImages> views;
  for (const Seen& view : shown) views.push_back(view.images);
  const PictureScales scales = picture_scales(views);
  std::vector<ordered_json> pictures = encoded(views, scales, kMostBytes);
  json["limit_mm"] = 1e3 * scales.error_limit_m;
  for (size_t i = 0; i < shown.size(); ++i) {
    pictures[i].erase("depth");
    pictures[i]["index"] = views[i].index;
    pictures[i]["lost"] = shown[i].lost;
    json["views"].push_back(pictures[i]);
  }
  return json;
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
#include "core/score/truth_files.h"

#include <map>

#include "core/io/files.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

using Channels = std::map<std::string, cv::Mat1f>;

Channels read_channels(const std::filesystem::path& file, const std::optional<ExpectedSize>& expected) {
  Channels channels;
  for (const ExrChannel& each : read_exr(file, expected)) channels[each.name] = each.image;
  return channels;
}

std::optional<ExpectedSize> size_of(const Pinhole* camera) {
  if (!camera) return std::nullopt;
  return ExpectedSize{{camera->width, camera->height}, "the camera of rig.yaml"};
}

cv::Mat1f channel(const Channels& channels, const std::string& name, const std::filesystem::path& file) {
  const auto found = channels.find(name);
  if (found == channels.end()) throw Error(file.string() + ": has no channel '" + name + "'");
  return found->second;
}

}  // namespace

TruthFrame read_truth_frame(const std::filesystem::path& file, const Pinhole* camera) {
  const Channels channels = read_channels(file, size_of(camera));
  TruthFrame truth;
  truth.depth_m = channel(channels, "depth_m", file);
  cv::merge(std::vector<cv::Mat>{channel(channels, "normal.x", file), channel(channels, "normal.y", file),
                                 channel(channels, "normal.z", file)},
            truth.normals);
  truth.object_id = channel(channels, "object_id", file);
  truth.projector_column = channel(channels, "projector_column", file);
  truth.mask = channel(channels, "mask", file);
  const auto indirect = channels.find("indirect_share");
  if (indirect != channels.end()) truth.indirect_share = indirect->second;
  return truth;
}

DepthEstimate read_depth_estimate(const std::filesystem::path& file, const Pinhole* camera) {
  const Channels channels = read_channels(file, size_of(camera));
  return {channel(channels, "depth_m", file), channel(channels, "sigma_m", file),
          channel(channels, "projector_column", file)};
}

}  // namespace fringeslam

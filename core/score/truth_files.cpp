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

cv::Mat1f optional_channel(const Channels& channels, const std::string& name) {
  const auto found = channels.find(name);
  return found == channels.end() ? cv::Mat1f() : found->second;
}

cv::Mat3f vectors(const Channels& channels, const std::string& name, const std::filesystem::path& file) {
  cv::Mat3f image;
  cv::merge(std::vector<cv::Mat>{channel(channels, name + ".x", file), channel(channels, name + ".y", file),
                                 channel(channels, name + ".z", file)},
            image);
  return image;
}

}  // namespace

TruthFrame read_truth_frame(const std::filesystem::path& file, const Pinhole* camera) {
  const Channels channels = read_channels(file, size_of(camera));
  TruthFrame truth;
  truth.depth_m = channel(channels, "depth_m", file);
  if (channels.contains("position.x")) truth.position_m = vectors(channels, "position", file);
  truth.normals = vectors(channels, "normal", file);
  truth.object_id = channel(channels, "object_id", file);
  truth.projector_column = channel(channels, "projector_column", file);
  truth.projector_row = optional_channel(channels, "projector_row");
  truth.temperature_c = optional_channel(channels, "temperature_c");
  truth.mask = channel(channels, "mask", file);
  truth.indirect_share = optional_channel(channels, "indirect_share");
  return truth;
}

DepthEstimate read_depth_estimate(const std::filesystem::path& file, const Pinhole* camera) {
  const Channels channels = read_channels(file, size_of(camera));
  return {channel(channels, "depth_m", file), channel(channels, "sigma_m", file),
          channel(channels, "projector_column", file)};
}

}  // namespace fringeslam

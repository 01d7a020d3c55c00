// SPDX-License-Identifier: Apache-2.0
#include "core/score/truth_files.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <map>

#include "core/types/error.h"

namespace fringeslam {

namespace {

using Channels = std::map<std::string, cv::Mat1f>;

Channels read_exr(const std::filesystem::path& file) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) throw Error(file.string() + ": does not exist");
  const auto in = OIIO::ImageInput::open(file.string());
  if (!in) throw Error(file.string() + ": cannot be read as an image: " + OIIO::geterror());
  const OIIO::ImageSpec& spec = in->spec();
  if (spec.width < 1 || spec.height < 1 || spec.width > 16384 || spec.height > 16384)
    throw Error(file.string() + ": invalid image size");
  cv::Mat pixels(spec.height, spec.width, CV_32FC(spec.nchannels));
  if (!in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, pixels.data))
    throw Error(file.string() + ": is truncated or damaged: " + in->geterror());
  std::vector<cv::Mat> planes;
  cv::split(pixels, planes);
  Channels channels;
  for (size_t i = 0; i < planes.size(); ++i) channels[spec.channelnames[i]] = planes[i];
  return channels;
}

cv::Mat1f channel(const Channels& channels, const std::string& name, const std::filesystem::path& file) {
  const auto found = channels.find(name);
  if (found == channels.end()) throw Error(file.string() + ": has no channel '" + name + "'");
  return found->second;
}

}  // namespace

TruthFrame read_truth_frame(const std::filesystem::path& file) {
  const Channels channels = read_exr(file);
  TruthFrame truth;
  truth.depth_m = channel(channels, "depth_m", file);
  cv::merge(std::vector<cv::Mat>{channel(channels, "normal.x", file), channel(channels, "normal.y", file),
                                 channel(channels, "normal.z", file)},
            truth.normals);
  truth.object_id = channel(channels, "object_id", file);
  truth.projector_column = channel(channels, "projector_column", file);
  truth.mask = channel(channels, "mask", file);
  return truth;
}

DepthEstimate read_depth_estimate(const std::filesystem::path& file) {
  const Channels channels = read_exr(file);
  return {channel(channels, "depth_m", file), channel(channels, "sigma_m", file),
          channel(channels, "projector_column", file)};
}

}  // namespace fringeslam

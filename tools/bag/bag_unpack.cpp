// SPDX-License-Identifier: Apache-2.0
#include "tools/bag/bag_unpack.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>

#include "core/io/files.h"
#include "core/rig/dataset.h"
#include "tools/bag/bag_dataset.h"
#include "tools/bag/bag_stream.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

bool has_images(const BagTopic& topic) {
  return topic.type == "sensor_msgs/Image" || topic.type == "sensor_msgs/CompressedImage";
}

// The topic that is selected, or the only one with images.
BagTopic image_topic(const fs::path& file, const std::string& wanted) {
  const std::vector<BagTopic> topics = BagStream(file, {}).topics();
  std::string list;
  std::vector<BagTopic> candidates;
  for (const BagTopic& topic : topics) {
    if (!wanted.empty() ? topic.name == wanted : has_images(topic)) candidates.push_back(topic);
    if (has_images(topic))
      list += (list.empty() ? "" : ", ") + topic.name + " (" + std::to_string(topic.messages) + ")";
  }
  if (list.empty()) throw Error(file.string() + ": has no images, that is, no topic with sensor_msgs/Image");
  if (candidates.empty()) throw Error(file.string() + ": has no topic " + wanted + "; topics with images: " + list);
  if (candidates.size() > 1)
    throw Error(file.string() + ": has several topics with images: " + list +
                "; name one as `bag: {topic: ...}` in import.yaml");
  return candidates.front();
}

// Writes an image under a name without extension.
void write_image(const fs::path& stem, const BagImage& image, const std::string& where) {
  if (image.encoding == kCompressed) {
    const std::string bytes(image.bytes.begin(), image.bytes.end());
    const bool png = bytes.starts_with("\x89PNG"), jpeg = bytes.starts_with("\xff\xd8");
    if (!png && !jpeg) throw Error(where + ": is compressed, but neither as PNG nor as JPEG");
    return write_text(stem.string() + (png ? ".png" : ".jpg"), bytes);
  }
  const cv::Mat pixels = image_of(image, where);
  if (pixels.depth() == CV_32F)
    write_exr(stem.string() + ".exr", {{"Y", pixels}});
  else
    write_png(stem.string() + ".png", pixels);
}

std::string seconds_text(BagTime time) {
  char text[48];
  std::snprintf(text, sizeof text, "%" PRId64 ".%09" PRId64 "\n", time / 1000000000, time % 1000000000);
  return text;
}

struct Interval {
  BagTime length = 0;
  size_t stack = 0, image = 0;  // before it
};

BagTime median_length(std::vector<Interval> intervals) {
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>((intervals.size() - 1) / 2);
  std::nth_element(intervals.begin(), middle, intervals.end(),
                   [](const Interval& a, const Interval& b) { return a.length < b.length; });
  return middle->length;
}

// An interval that is much longer than the others may hide lost images, after which all are assigned to the wrong patterns.
// Those between stacks count if most of them are not longer, as without pauses.
std::vector<std::string> gap_warnings(const fs::path& file, const std::vector<std::vector<BagTime>>& stacks) {
  constexpr BagTime kLong = 3;  // times the median, in halves; twice the median if one image was lost
  const auto is_long = [](BagTime interval, BagTime median) { return 2 * interval > kLong * median; };
  std::vector<Interval> intervals, between;
  for (size_t s = 0; s < stacks.size(); ++s) {
    const std::vector<BagTime>& times = stacks[s];
    for (size_t i = 0; i + 1 < times.size(); ++i) intervals.push_back({times[i + 1] - times[i], s, i});
    if (s + 1 < stacks.size()) between.push_back({stacks[s + 1].front() - times.back(), s, times.size() - 1});
  }
  if (intervals.size() < 3) return {};
  const BagTime median = median_length(intervals);
  if (!between.empty() && !is_long(median_length(between), median))
    intervals.insert(intervals.end(), between.begin(), between.end());
  const Interval longest = *std::max_element(intervals.begin(), intervals.end(),
                                             [](const Interval& a, const Interval& b) { return a.length < b.length; });
  if (!is_long(longest.length, median)) return {};
  const bool last = longest.image + 1 == stacks[longest.stack].size();
  char text[320];
  std::snprintf(text, sizeof text,
                ": %.4g s pass between image %zu of stack %zu and image %zu of stack %zu, but %.4g s in the median; if "
                "images were lost there, the patterns are wrong",
                1e-9 * static_cast<double>(longest.length), longest.image, longest.stack, last ? 0 : longest.image + 1,
                last ? longest.stack + 1 : longest.stack, 1e-9 * static_cast<double>(median));
  return {file.string() + text};
}

}  // namespace

std::vector<std::string> unpack_bag(const fs::path& file, const BagSelection& selection, const fs::path& folder) {
  const BagTopic topic = image_topic(file, selection.topic);
  const std::string where = file.string() + ": " + topic.name;
  const int64_t available = static_cast<int64_t>(topic.messages) - selection.first, per_stack = selection.per_stack;
  const int64_t stacks = selection.stacks > 0 ? selection.stacks : available / per_stack;
  if (stacks < 1 || stacks * per_stack > available || (selection.stacks == 0 && available % per_stack != 0))
    throw Error(where + ": has " + std::to_string(topic.messages) + " images, which, after the first " +
                std::to_string(selection.first) + ", are not " +
                (selection.stacks > 0 ? std::to_string(stacks) : "whole") + " stacks of " + std::to_string(per_stack) +
                "; adjust first, stacks and images_per_stack of `bag:`");
  BagStream stream(file, {topic.name});
  std::vector<std::vector<BagTime>> times;
  BagTime last = 0;
  for (int64_t number = 0; number < selection.first + stacks * per_stack; ++number) {
    const auto message = stream.next();
    const std::string here = where + ", image " + std::to_string(number);
    if (!message) throw Error(here + ": is missing, although the index lists it");
    if (number < selection.first) continue;
    const int64_t index = (number - selection.first) % per_stack;
    if (message->stamp <= last) throw Error(here + ": its stamp is not later than that of the image before it");
    last = message->stamp;
    if (index == 0) times.emplace_back();
    const fs::path stack = folder / stack_name(static_cast<int>(times.size()) - 1);
    fs::create_directory(stack);
    char name[32];
    std::snprintf(name, sizeof name, "%02d", static_cast<int>(index));
    write_image(stack / name, message->image, here);
    times.back().push_back(last);
    if (index + 1 < per_stack) continue;
    std::string text;
    for (const BagTime time : times.back()) text += seconds_text(time);
    write_text(stack / kBagTimesFile, text);
  }
  return gap_warnings(file, times);
}

}  // namespace fringeslam::tools

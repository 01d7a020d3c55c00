// SPDX-License-Identifier: Apache-2.0
// ROS 1 bag files through librosbag-storage, without ROS types in the interface. Only the standard messages that
// tools/bag/bag_dataset.h uses are supported.
//
// This header is C++17, because the message headers of ROS 1 do not compile as C++20. Without librosbag-storage at build
// time (has_bags() is false), all functions throw the error of require_bags().
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace fringeslam::tools {

bool has_bags();
// Throws Error that names the missing packages unless has_bags(). `what` begins the message.
void require_bags(const std::string& what);

// Nanoseconds since 1970. ROS treats 0 as invalid and has no times before it.
using BagTime = std::int64_t;
constexpr BagTime kLatestBagTime = (std::int64_t{1} << 32) * 1000000000 - 1;

// sensor_msgs/Image; rows of `step` bytes.
struct BagImage {
  std::string encoding;  // mono8, mono16, 32FC1 …
  bool big_endian = false;
  std::uint32_t width = 0, height = 0, step = 0;
  std::vector<std::uint8_t> bytes;
};

// sensor_msgs/CameraInfo with distortion model plumb_bob.
struct BagLens {
  std::uint32_t width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // all 0: not calibrated
  std::array<double, 5> distortion = {};  // k1 k2 p1 p2 k3
};

// sensor_msgs/PointCloud2, organized as an image, with one float per field.
struct BagCloud {
  std::uint32_t width = 0, height = 0;
  std::vector<std::string> fields;
  std::vector<float> values;  // all fields of a point, then those of the next one
};

struct BagPose {
  std::array<double, 3> translation_m = {};
  std::array<double, 4> xyzw = {0, 0, 0, 1};
};

using BagPath = std::vector<std::pair<BagTime, BagPose>>;

struct BagTransform {
  BagTime stamp = 0;
  std::string parent, child;
  BagPose parent_from_child;
};

// Where and when a message is recorded. A latched topic is delivered to subscribers that connect later, too.
struct BagPlace {
  std::string topic, frame;
  BagTime stamp = 0;
  bool latched = false;
};

// Writes a bag. Equal calls give equal bytes. The functions throw Error naming the file if it cannot be written.
class BagWriter {
 public:
  explicit BagWriter(std::filesystem::path file);
  ~BagWriter();
  void text(const BagPlace& place, const std::string& text);  // std_msgs/String
  void image(const BagPlace& place, BagImage image);
  void lens(const BagPlace& place, const BagLens& lens);
  void cloud(const BagPlace& place, const BagCloud& cloud);
  void transforms(const BagPlace& place, const std::vector<BagTransform>& transforms);  // tf2_msgs/TFMessage
  void path(const BagPlace& place, const BagPath& poses);                               // nav_msgs/Path
  // Completes the file.
  void close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct BagTopic {
  std::string name, type;
  std::uint64_t messages = 0;
};

// BagImage::encoding of sensor_msgs/CompressedImage: `bytes` is an image file.
constexpr const char* kCompressed = "compressed";

struct BagMessage {
  std::string topic;
  BagTime recorded = 0;
  BagTime stamp = 0;  // of the header; `recorded` if the message has none or it is 0
  std::string text;   // of std_msgs/String
  BagImage image;     // of sensor_msgs/Image or CompressedImage
  BagPath path;       // of nav_msgs/Path
};

// Reads a bag in this process: passes its topics, then the messages of `topics` in order of their recording times. Throws
// Error if the file is not a bag or if these topics have other types than String, Image, CompressedImage and Path. Damaged files can crash the
// library or exhaust the memory, so use BagStream instead.
void read_bag(const std::filesystem::path& file, const std::vector<std::string>& topics,
              const std::function<void(const std::vector<BagTopic>&)>& take_topics,
              const std::function<void(const BagMessage&)>& take_message);

}  // namespace fringeslam::tools

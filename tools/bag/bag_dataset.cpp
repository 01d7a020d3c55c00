// SPDX-License-Identifier: Apache-2.0
#include "tools/bag/bag_dataset.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "core/io/files.h"
#include "core/io/yaml.h"
#include "core/rig/rig_file.h"
#include "tools/bag/bag_stream.h"
#include "tools/board_file.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kBagFormat = "fringeslam-bag-1";
constexpr const char kDatasetTopic[] = "/fringeslam/dataset", kRigTopic[] = "/fringeslam/rig",
                     kPatternsTopic[] = "/fringeslam/patterns", kBoardTopic[] = "/fringeslam/board",
                     kStackTopic[] = "/fringeslam/stack", kImageTopic[] = "/camera/image_raw",
                     kThermalTopic[] = "/thermal/image_raw", kPathTopic[] = "/ground_truth/path";
constexpr double kClockFrom1970_s = 1e8, kOffset_s = 1e9;
constexpr int kMostPixels = 16384;

BagImage bag_image(const cv::Mat& image) {
  BagImage out;
  out.encoding = image.type() == CV_8UC1 ? "mono8" : image.type() == CV_16UC1 ? "mono16" : "32FC1";
  out.width = static_cast<uint32_t>(image.cols), out.height = static_cast<uint32_t>(image.rows);
  out.step = static_cast<uint32_t>(image.cols * image.elemSize());
  for (int row = 0; row < image.rows; ++row)
    out.bytes.insert(out.bytes.end(), image.ptr(row), image.ptr(row) + out.step);
  return out;
}

BagLens bag_lens(const Pinhole& lens, bool calibrated) {
  BagLens out;
  out.width = static_cast<uint32_t>(lens.width), out.height = static_cast<uint32_t>(lens.height);
  if (!calibrated) return out;
  out.fx = lens.fx, out.fy = lens.fy, out.cx = lens.cx, out.cy = lens.cy;
  const Distortion& d = lens.distortion;
  out.distortion = {d.k1, d.k2, d.p1, d.p2, d.k3};
  return out;
}

BagPose bag_pose(const Pose& pose) {
  const Eigen::Vector4d q = quaternion_xyzw(pose.rotation);
  const Eigen::Vector3d& t = pose.translation;
  return {{t.x(), t.y(), t.z()}, {q[0], q[1], q[2], q[3]}};
}

BagCloud bag_cloud(const Frame& frame) {
  BagCloud cloud;
  cloud.width = static_cast<uint32_t>(frame.width()), cloud.height = static_cast<uint32_t>(frame.height());
  cloud.fields = {"x", "y", "z", "intensity", "sigma"};
  cloud.values.reserve(cloud.fields.size() * frame.points_m.total());
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const cv::Vec3f& point = frame.points_m(row, col);
      for (const float value : {point[0], point[1], point[2], static_cast<float>(frame.texture(row, col)),
                                frame.valid(row, col) ? frame.sigma_m(row, col) : NAN})
        cloud.values.push_back(value);
    }
  }
  return cloud;
}

// The earliest of the times of a stack.
double first_time_s(const FringeStack& stack) {
  return std::min(stack.timestamp_s, *std::min_element(stack.exposure_time_s.begin(), stack.exposure_time_s.end()));
}

bool wrote(const fs::path& bag) {
  try {
    return is_bag(bag) && is_our_bag(BagStream(bag, {}).topics());
  } catch (const Error&) {
    return false;
  }
}

// Throws Error if writing would replace something other than a bag that this program wrote.
const fs::path& replaceable(const fs::path& file) {
  std::error_code ignored;
  if (fs::exists(file, ignored) && !wrote(file))
    throw Error(file.string() +
                ": exists and is not a ROS bag written by fringeslam; choose another --out or remove it");
  return file;
}

const fs::path& supported(const fs::path& file) {
  require_bags(file.string());
  return replaceable(file);
}

}  // namespace

double clock_offset_s(double time_s) { return time_s > kClockFrom1970_s ? 0 : kOffset_s; }

BagTime bag_time(double time_s, double offset_s) {
  // Seconds and fraction separately, because their sum in nanoseconds has more digits than a double.
  const double seconds = std::floor(time_s);
  if (std::abs(seconds) < 5e9) {
    const BagTime time = (static_cast<BagTime>(seconds) + static_cast<BagTime>(offset_s)) * 1000000000 +
                         std::llround(1e9 * (time_s - seconds));
    if (time > 0 && time <= kLatestBagTime) return time;
  }
  throw Error("a capture time of " + to_text(time_s) + " s cannot be stored in a ROS bag (1970 to 2106)");
}

BagRecorder::BagRecorder(const fs::path& out, RigModel model, PatternSequence sequence, DatasetInfo info,
                         std::string board_yaml)
    : staged_(supported(out)),
      bag_(staged_.path()),
      model_(std::move(model)),
      sequence_(std::move(sequence)),
      info_(std::move(info)),
      board_yaml_(std::move(board_yaml)) {}

BagRecorder::~BagRecorder() = default;

fs::path BagRecorder::scratch() const { return staged_.path().parent_path() / "scratch"; }

BagTime BagRecorder::stamp(double time_s) const { return bag_time(time_s, *offset_s_); }

void BagRecorder::begin(const FringeStack& stack) {
  if (offset_s_) return;
  offset_s_ = clock_offset_s(first_time_s(stack));
  const BagTime first = stamp(first_time_s(stack));
  const auto text = [&](const char* topic, const std::string& content) {
    bag_.text({topic, "", first, true}, content);
  };
  text(kDatasetTopic, std::string("format: ") + kBagFormat + "\nname: " + yaml_quoted(info_.name) +
                          "\nseed: " + std::to_string(info_.seed) + "\nclock_offset_s: " + to_text(*offset_s_) + "\n" +
                          (info_.imported ? "imported: true\n" : "") +
                          (info_.image_times ? "image_times: true\n" : ""));
  text(kRigTopic, to_yaml(model_));
  text(kPatternsTopic, to_yaml(sequence_));
  if (!board_yaml_.empty()) text(kBoardTopic, board_yaml_);
  bag_.lens({"/projector/camera_info", "projector", first, true}, bag_lens(model_.projector, model_.calibrated));
  if (!model_.calibrated) return;
  std::vector<BagTransform> transforms = {
      {first, "robot", "camera", bag_pose(model_.robot_from_camera)},
      {first, "camera", "projector", bag_pose(model_.projector_from_camera.inverse())}};
  if (model_.thermal)
    transforms.push_back({first, "camera", "thermal", bag_pose(model_.thermal->thermal_from_camera.inverse())});
  bag_.transforms({"/tf_static", "", first, true}, transforms);
}

void BagRecorder::add(const FringeStack& stack) {
  check_stack(stack);
  begin(stack);
  bag_.text({kStackTopic, "", stamp(first_time_s(stack))}, stack_yaml(stack));
  const BagLens lens = bag_lens(model_.camera, model_.calibrated);
  for (size_t i = 0; i < stack.images.size(); ++i) {
    const BagTime exposure = stamp(stack.exposure_time_s[i]);
    bag_.image({kImageTopic, "camera", exposure}, bag_image(stack.images[i]));
    bag_.lens({"/camera/camera_info", "camera", exposure}, lens);
  }
  if (!stack.thermal_c.empty()) add_thermal(stack);
}

void BagRecorder::add_thermal(const FringeStack& stack) {
  const BagPlace place{kThermalTopic, "thermal", stamp(stack.timestamp_s)};
  BagImage image;
  if (const auto recorded = centikelvin_image(stack.thermal_c)) {
    image = bag_image(*recorded);
    image.encoding = "16UC1";
  } else {
    image = bag_image(stack.thermal_c);
  }
  bag_.image(place, std::move(image));
  if (model_.thermal) bag_.lens({"/thermal/camera_info", "thermal", place.stamp}, bag_lens(model_.thermal->lens, true));
}

void BagRecorder::add(const RgbdView& view) {
  add(view.stack);
  const BagTime time = stamp(view.stack.timestamp_s);
  bag_.image({"/camera/texture", "camera", time}, bag_image(view.frame.texture));
  bag_.image({"/camera/depth", "camera", time}, bag_image(view.depth_m));
  bag_.cloud({"/camera/points", "camera", time}, bag_cloud(view.frame));
}

void BagRecorder::finish(const Trajectory& robot) {
  BagPath path;
  for (const TimedPose& pose : robot) {
    const BagTime time = stamp(pose.timestamp_s);
    path.emplace_back(time, bag_pose(pose.world_from_robot));
    bag_.transforms({"/ground_truth/tf", "", time}, {{time, "world", "robot", path.back().second}});
  }
  if (!path.empty()) bag_.path({kPathTopic, "world", path.back().first}, path);
  bag_.close();
  fs::remove_all(scratch());
  staged_.commit();
}

WrittenViews write_bag(Source& source, const Settings& settings, const RgbdOptions& options, bool with_truth,
                       const fs::path& out, const Common& common) {
  require_bags(out.string());
  prepare(source, options, out.string());
  DatasetInfo info;
  info.name = source.name(), info.seed = source.seed();
  info.imported = source.imported();
  info.image_times = source.imported() && source.has_image_times();
  BagRecorder recorder(out, source.model(), source.sequence(), info, read_bytes(source.board_file()));
  fs::create_directory(recorder.scratch());
  WrittenViews written;
  written.robot =
      for_each_view(source, settings, options, recorder.scratch(), out.string(), common, [&](const RgbdView& view) {
        recorder.add(view);
        ++written.views;
      });
  recorder.finish(with_truth ? written.robot : Trajectory());
  for (TimedPose& pose : written.robot) pose.timestamp_s += recorder.offset_s();
  return written;
}

// --- reading ---

bool is_our_bag(const std::vector<BagTopic>& topics) {
  return std::any_of(topics.begin(), topics.end(), [](const BagTopic& t) { return t.name == kDatasetTopic; });
}

bool is_bag(const fs::path& file) {
  std::error_code ignored;
  char start[7] = {};
  if (fs::is_regular_file(file, ignored)) std::ifstream(file, std::ios::binary).read(start, sizeof start);
  return std::string(start, sizeof start) == "#ROSBAG";
}

Trajectory true_camera_trajectory(const fs::path& file, const BagLimits& limits) {
  BagStream stream(file, {kRigTopic, kPathTopic});
  std::string rig;
  Trajectory robot;
  while (const auto message = stream.next()) {
    if (message->topic == kRigTopic) rig = message->text;
    if (message->path.size() > limits.poses - robot.size())
      throw Error(file.string() + ": " + kPathTopic + ": has more than " + std::to_string(limits.poses) + " poses");
    for (const auto& [stamp, pose] : message->path) {
      const auto& [x, y, z, w] = pose.xyzw;
      const auto& [tx, ty, tz] = pose.translation_m;
      const Eigen::Vector4d xyzw(x, y, z, w);
      const double time_s = 1e-9 * static_cast<double>(stamp);
      if (!(std::abs(xyzw.norm() - 1) < 1e-3) || (!robot.empty() && robot.back().timestamp_s >= time_s))
        throw Error(file.string() + ": " + kPathTopic + ": has poses that are not rotations or not in order of time");
      robot.push_back({time_s, {rotation_from_quaternion(xyzw), {tx, ty, tz}}});
    }
  }
  if (rig.empty() || robot.empty())
    throw Error(file.string() + ": has no ground truth: needs " + kPathTopic + " and " + kRigTopic);
  return camera_trajectory(std::move(robot), read_rig(YamlMap::parse(rig, file.string() + ": " + kRigTopic)));
}

namespace {

struct Encoding {
  const char* name;
  int type;
  int to_bgr;  // cv::ColorConversionCodes; -1: none
};

constexpr Encoding kEncodings[] = {{"mono8", CV_8UC1, -1},
                                   {"8UC1", CV_8UC1, -1},
                                   {"mono16", CV_16UC1, -1},
                                   {"16UC1", CV_16UC1, -1},
                                   {"32FC1", CV_32FC1, -1},
                                   {"bgr8", CV_8UC3, -1},
                                   {"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
                                   {"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
                                   {"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR}};

const Encoding& encoding_of(const BagImage& image, const std::string& where) {
  std::string known;
  for (const Encoding& encoding : kEncodings) {
    if (image.encoding == encoding.name) return encoding;
    known += (known.empty() ? "" : ", ") + std::string(encoding.name);
  }
  throw Error(where + ": has the encoding '" + image.encoding + "'; supported are " + known);
}

}  // namespace

cv::Mat image_of(const BagImage& image, const std::string& where) {
  const Encoding& encoding = encoding_of(image, where);
  if (image.width < 1 || image.height < 1 || image.width > kMostPixels || image.height > kMostPixels)
    throw Error(where + ": has " + std::to_string(image.width) + "x" + std::to_string(image.height) + " px");
  const size_t row_bytes = image.width * static_cast<size_t>(CV_ELEM_SIZE(encoding.type));
  if (image.step < row_bytes || image.bytes.size() != size_t{image.step} * image.height)
    throw Error(where + ": has " + std::to_string(image.bytes.size()) + " bytes in rows of " +
                std::to_string(image.step) + ", which is not an image of " + std::to_string(image.width) + "x" +
                std::to_string(image.height) + " px in " + image.encoding);
  cv::Mat out(static_cast<int>(image.height), static_cast<int>(image.width), encoding.type);
  for (int row = 0; row < out.rows; ++row)
    std::memcpy(out.ptr(row), image.bytes.data() + size_t{image.step} * static_cast<size_t>(row), row_bytes);
  if (image.big_endian && out.depth() == CV_16U) {
    for (auto pixel = out.begin<uint16_t>(); pixel != out.end<uint16_t>(); ++pixel)
      *pixel = static_cast<uint16_t>(*pixel << 8 | *pixel >> 8);
  } else if (image.big_endian && out.depth() == CV_32F) {
    throw Error(where + ": has big-endian floats, which are not supported");
  }
  if (encoding.to_bgr >= 0) cv::cvtColor(out, out, encoding.to_bgr);
  return out;
}

struct BagRig::Images {
  Images(const fs::path& file, const std::string& topic) : stream(file, {topic}), where(file.string() + ": " + topic) {}
  BagStream stream;
  std::string where;
  int read = 0;
  std::vector<std::pair<BagTime, cv::Mat>> early;  // images of later stacks and their stamps

  BagMessage next() {
    auto message = stream.next();
    if (!message)
      throw Error(where + ": ends after " + std::to_string(read) + " images, fewer than " + kStackTopic + " lists");
    ++read;
    return std::move(*message);
  }
  std::string number() const { return where + ", image " + std::to_string(read); }
};

BagRig::BagRig(fs::path file, const BagLimits& limits) : file_(std::move(file)) {
  BagStream stream(file_, {kDatasetTopic, kRigTopic, kPatternsTopic, kBoardTopic, kStackTopic});
  std::string dataset, rig, patterns;
  size_t text_bytes = 0;
  while (auto message = stream.next()) {
    const size_t bytes = message->text.size();
    const auto refuse_above = [&](size_t value, size_t most, const std::string& of) {
      if (value > most)
        throw Error(file_.string() + ": " + message->topic + ": more than " + std::to_string(most) + of +
                    ", the limit for a bag; record or import it in parts");
    };
    refuse_above(bytes, limits.text_bytes, " bytes in a message");
    refuse_above(text_bytes += bytes, limits.all_text_bytes, " bytes of text up to here");
    if (message->topic == kStackTopic) refuse_above(stacks_.size() + 1, limits.stacks, " stacks");
    if (message->topic == kDatasetTopic) dataset = message->text;
    if (message->topic == kRigTopic) rig = message->text;
    if (message->topic == kPatternsTopic) patterns = message->text;
    if (message->topic == kBoardTopic) board_yaml_ = message->text;
    if (message->topic == kStackTopic) stacks_.push_back(std::move(message->text));
  }
  const auto parsed = [&](const std::string& text, const char* topic) {
    if (text.empty()) throw Error(file_.string() + ": has no message on " + topic);
    return YamlMap::parse(text, file_.string() + ": " + topic);
  };
  const YamlMap map = parsed(dataset, kDatasetTopic);
  if (map.text("format") != kBagFormat)
    throw map.error("format", "format is not '" + std::string(kBagFormat) + "'; this version reads only that format");
  info_.name = map.text("name");
  info_.seed = map.seed("seed");
  offset_s_ = map.number("clock_offset_s", {0, 1e9});
  info_.imported = map.boolean_or("imported", false);
  info_.image_times = map.boolean_or("image_times", false);
  map.finish();
  model_ = read_rig(parsed(rig, kRigTopic));
  sequence_ = read_patterns(parsed(patterns, kPatternsTopic));
  if (stacks_.empty()) throw Error(file_.string() + ": has no message on " + kStackTopic);
  info_.stacks = static_cast<int>(stacks_.size());
  images_ = std::make_unique<Images>(file_, kImageTopic);
  for (const BagTopic& topic : images_->stream.topics()) {
    if (topic.name == kThermalTopic) info_.has_thermal = true;
  }
  if (info_.has_thermal && !model_.thermal)
    throw Error(file_.string() + ": " + kRigTopic + " has no 'thermal' section, although there is " + kThermalTopic);
  if (info_.has_thermal) thermal_ = std::make_unique<Images>(file_, kThermalTopic);
}

BagRig::~BagRig() = default;

void BagRig::recalibrate(const RigModel& calibration) {
  try {
    model_ = with_calibration(model_, calibration);
  } catch (const Error& e) {
    throw Error(file_.string() + ": " + e.what());
  }
}

// Reads the next image of a topic for a device of a given size.
cv::Mat BagRig::image_for(const Pinhole& lens, Images& images, const BagMessage& message) const {
  cv::Mat image = image_of(message.image, images.number());
  if (image.cols != lens.width || image.rows != lens.height)
    throw Error(images.number() + ": is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                " but the camera of " + kRigTopic + " has " + std::to_string(lens.width) + "x" +
                std::to_string(lens.height));
  return image;
}

cv::Mat1f BagRig::thermal_image() {
  const BagMessage message = thermal_->next();
  return celsius_image(image_for(model_.thermal->lens, *thermal_, message), thermal_->number());
}

std::optional<FringeStack> BagRig::capture(const PatternSequence& sequence) {
  if (!(sequence == sequence_)) throw Error(file_.string() + ": was recorded with a different pattern sequence");
  if (next_ == stacks_.size()) return std::nullopt;
  FringeStack stack;
  stack.index = static_cast<int>(next_);
  stack.patterns = sequence_;
  const size_t count = sequence_.patterns.size();
  read_stack_times(
      YamlMap::parse(stacks_[next_], file_.string() + ": " + kStackTopic + ", stack " + std::to_string(next_)), count,
      model_.timing, stack);
  // Images are in order of time, which need not be that of the patterns, and the first images of the next stack may be
  // among them.
  stack.images.resize(count);
  auto early = std::exchange(images_->early, {});
  size_t missing = count;
  const auto assign = [&](BagTime stamp, cv::Mat image) {
    for (size_t slot = 0; slot < count; ++slot) {
      if (!stack.images[slot].empty() || bag_time(stack.exposure_time_s[slot], offset_s_) != stamp) continue;
      stack.images[slot] = std::move(image);
      --missing;
      return;
    }
    images_->early.emplace_back(stamp, std::move(image));
    if (images_->early.size() > count)
      throw Error(images_->number() + ": has a stamp that stack " + std::to_string(next_) + " of " + kStackTopic +
                  " does not list, like too many before it");
  };
  for (auto& [stamp, image] : early) assign(stamp, std::move(image));
  while (missing > 0) {
    const BagMessage message = images_->next();
    assign(message.stamp, image_for(model_.camera, *images_, message));
  }
  for (const cv::Mat& image : stack.images) {
    if (image.channels() != 1 || image.type() != stack.images.front().type())
      throw Error(images_->where + ": stack " + std::to_string(next_) + " has images of different or colored types");
  }
  if (info_.has_thermal) stack.thermal_c = thermal_image();
  ++next_;
  return stack;
}

}  // namespace fringeslam::tools

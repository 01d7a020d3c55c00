// SPDX-License-Identifier: Apache-2.0
// The only file that includes ROS; compiled as C++17.
#include <nav_msgs/Path.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <tuple>
#include <utility>

#include "core/types/error.h"
#include "tools/bag/bag.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr BagTime kNanosecondsPerSecond = 1000000000;

ros::Time ros_time(BagTime time) {
  if (time <= 0 || time > kLatestBagTime) throw Error("a time of " + std::to_string(time) + " ns is none in ROS");
  return {static_cast<uint32_t>(time / kNanosecondsPerSecond), static_cast<uint32_t>(time % kNanosecondsPerSecond)};
}

BagTime bag_time(const ros::Time& time) {
  return static_cast<BagTime>(time.sec) * kNanosecondsPerSecond + static_cast<BagTime>(time.nsec);
}

template <class Header>
Header header_of(const BagPlace& place) {
  Header header;
  header.stamp = ros_time(place.stamp);
  header.frame_id = place.frame;
  return header;
}

template <class Transform>
void set_translation(Transform& to, const BagPose& pose) {
  to.x = pose.translation_m[0], to.y = pose.translation_m[1], to.z = pose.translation_m[2];
}

template <class Quaternion>
void set_rotation(Quaternion& to, const BagPose& pose) {
  to.x = pose.xyzw[0], to.y = pose.xyzw[1], to.z = pose.xyzw[2], to.w = pose.xyzw[3];
}

}  // namespace

bool has_bags() { return true; }
void require_bags(const std::string&) {}

struct BagWriter::Impl {
  fs::path file;
  std::unique_ptr<rosbag::Bag> bag = std::make_unique<rosbag::Bag>();
  std::map<std::string, uint32_t> sequence = {};  // next header.seq of each topic
  bool failed = false;                            // incomplete records: what is written after them would be misread

  explicit Impl(fs::path path) : file(std::move(path)) {}
  ~Impl() {
    try {
      if (!failed) bag->close();
    } catch (const std::exception&) {
      failed = true;
    }
    // The error was reported. The destructor of rosbag::Bag would throw it again, which ends the program.
    if (failed) (void)bag.release();
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  template <class Function>
  void guarded(const Function& function) {
    try {
      function();
    } catch (const Error&) {
      throw;
    } catch (const std::exception& e) {
      failed = true;
      throw Error(file.string() + ": cannot be written: " + e.what() + "; check the free disk space");
    }
  }

  template <class Message>
  void write(const BagPlace& place, const Message& message) {
    guarded([&] {
      const auto header = boost::make_shared<ros::M_string>();
      (*header)["topic"] = place.topic;
      (*header)["type"] = ros::message_traits::datatype(message);
      (*header)["md5sum"] = ros::message_traits::md5sum(message);
      (*header)["message_definition"] = ros::message_traits::definition(message);
      (*header)["callerid"] = "/fringeslam";
      if (place.latched) (*header)["latching"] = "1";
      bag->write(place.topic, ros_time(place.stamp), message, header);
    });
  }

  template <class Message>
  Message with_header(const BagPlace& place) {
    Message message;
    message.header = header_of<decltype(message.header)>(place);
    message.header.seq = sequence[place.topic]++;
    return message;
  }
};

BagWriter::BagWriter(fs::path file) : impl_(std::make_unique<Impl>(std::move(file))) {
  impl_->guarded([&] { impl_->bag->open(impl_->file.string(), rosbag::bagmode::Write); });
}

BagWriter::~BagWriter() = default;

void BagWriter::close() {
  if (impl_->failed)  // the index would follow an incomplete record
    throw Error(impl_->file.string() + ": cannot be written completely, because a message before could not be written");
  impl_->guarded([&] { impl_->bag->close(); });
}

void BagWriter::text(const BagPlace& place, const std::string& text) {
  std_msgs::String message;
  message.data = text;
  impl_->write(place, message);
}

void BagWriter::image(const BagPlace& place, BagImage image) {
  auto message = impl_->with_header<sensor_msgs::Image>(place);
  message.encoding = image.encoding;
  message.is_bigendian = image.big_endian;
  message.width = image.width, message.height = image.height, message.step = image.step;
  message.data = std::move(image.bytes);
  impl_->write(place, message);
}

void BagWriter::lens(const BagPlace& place, const BagLens& lens) {
  auto message = impl_->with_header<sensor_msgs::CameraInfo>(place);
  message.width = lens.width, message.height = lens.height;
  message.distortion_model = "plumb_bob";
  message.D.assign(lens.distortion.begin(), lens.distortion.end());
  const double last = lens.fx > 0 ? 1 : 0;  // K[0] = 0 is ROS's sign of an uncalibrated camera
  const double k[9] = {lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, last};
  const double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double p[12] = {lens.fx, 0, lens.cx, 0, 0, lens.fy, lens.cy, 0, 0, 0, last, 0};
  std::copy(std::begin(k), std::end(k), message.K.begin());
  std::copy(std::begin(r), std::end(r), message.R.begin());
  std::copy(std::begin(p), std::end(p), message.P.begin());
  impl_->write(place, message);
}

void BagWriter::cloud(const BagPlace& place, const BagCloud& cloud) {
  auto message = impl_->with_header<sensor_msgs::PointCloud2>(place);
  message.width = cloud.width, message.height = cloud.height;
  for (const std::string& name : cloud.fields) {
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = static_cast<uint32_t>(sizeof(float) * message.fields.size());
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    message.fields.push_back(field);
  }
  message.point_step = static_cast<uint32_t>(sizeof(float) * cloud.fields.size());
  message.row_step = message.point_step * message.width;
  message.is_dense = false;  // contains NaN
  const auto* bytes = reinterpret_cast<const uint8_t*>(cloud.values.data());
  message.data.assign(bytes, bytes + sizeof(float) * cloud.values.size());
  impl_->write(place, message);
}

void BagWriter::transforms(const BagPlace& place, const std::vector<BagTransform>& transforms) {
  tf2_msgs::TFMessage message;
  for (const BagTransform& transform : transforms) {
    geometry_msgs::TransformStamped stamped;
    stamped.header.stamp = ros_time(transform.stamp);
    stamped.header.frame_id = transform.parent;
    stamped.child_frame_id = transform.child;
    set_translation(stamped.transform.translation, transform.parent_from_child);
    set_rotation(stamped.transform.rotation, transform.parent_from_child);
    message.transforms.push_back(stamped);
  }
  impl_->write(place, message);
}

void BagWriter::path(const BagPlace& place, const BagPath& poses) {
  auto message = impl_->with_header<nav_msgs::Path>(place);
  for (const auto& [stamp, pose] : poses) {
    geometry_msgs::PoseStamped stamped;
    stamped.header.stamp = ros_time(stamp);
    stamped.header.frame_id = place.frame;
    set_translation(stamped.pose.position, pose);
    set_rotation(stamped.pose.orientation, pose);
    message.poses.push_back(stamped);
  }
  impl_->write(place, message);
}

namespace {

std::vector<BagTopic> topics_of(const rosbag::Bag& bag) {
  rosbag::View everything(bag);
  std::map<std::string, BagTopic> topics;
  for (const rosbag::ConnectionInfo* connection : everything.getConnections()) {
    BagTopic& topic = topics[connection->topic];
    topic.name = connection->topic, topic.type = connection->datatype;
  }
  std::vector<BagTopic> list;
  for (auto& [name, topic] : topics) {
    topic.messages = rosbag::View(bag, rosbag::TopicQuery(name)).size();
    list.push_back(std::move(topic));
  }
  return list;
}

BagMessage converted(const rosbag::MessageInstance& instance) {
  BagMessage message;
  message.topic = instance.getTopic();
  message.recorded = message.stamp = bag_time(instance.getTime());
  if (const auto text = instance.instantiate<std_msgs::String>()) {
    message.text = text->data;
  } else if (const auto image = instance.instantiate<sensor_msgs::Image>()) {
    if (!image->header.stamp.isZero()) message.stamp = bag_time(image->header.stamp);
    message.image.encoding = image->encoding;
    message.image.big_endian = image->is_bigendian != 0;
    message.image.width = image->width, message.image.height = image->height, message.image.step = image->step;
    message.image.bytes = std::move(image->data);
  } else if (const auto file = instance.instantiate<sensor_msgs::CompressedImage>()) {
    if (!file->header.stamp.isZero()) message.stamp = bag_time(file->header.stamp);
    message.image.encoding = kCompressed;
    message.image.bytes = std::move(file->data);
  } else if (const auto path = instance.instantiate<nav_msgs::Path>()) {
    for (const geometry_msgs::PoseStamped& stamped : path->poses) {
      const auto& [position, orientation] = std::tie(stamped.pose.position, stamped.pose.orientation);
      message.path.push_back(
          {bag_time(stamped.header.stamp),
           {{position.x, position.y, position.z}, {orientation.x, orientation.y, orientation.z, orientation.w}}});
    }
  } else {
    throw Error("topic " + message.topic + " contains " + instance.getDataType() + ", not images or text");
  }
  return message;
}

}  // namespace

void read_bag(const fs::path& file, const std::vector<std::string>& topics,
              const std::function<void(const std::vector<BagTopic>&)>& take_topics,
              const std::function<void(const BagMessage&)>& take_message) {
  try {
    rosbag::Bag bag(file.string(), rosbag::bagmode::Read);
    take_topics(topics_of(bag));
    if (topics.empty()) return;
    rosbag::View view(bag, rosbag::TopicQuery(topics));
    for (const rosbag::MessageInstance& instance : view) take_message(converted(instance));
  } catch (const rosbag::BagUnindexedException&) {
    throw Error("the bag has no index, as after an interrupted recording; repair it with `rosbag reindex`");
  }
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// Datasets in ROS bags. One bag contains the fringe images with the time of every exposure, what is measured from each
// stack, and the rig and the patterns as text, so that `import` needs nothing else:
//
//   topic                           type, frame            stamp, content
//   /fringeslam/dataset             String, latched        format, name, seed, clock_offset_s, imported, image_times
//   /fringeslam/rig, …/patterns     String, latched        rig.yaml, patterns.yaml
//   /fringeslam/board               String, latched        board.yaml, if the dataset has one
//   /fringeslam/stack               String                 per stack: stack.yaml
//   /camera/image_raw               Image camera           fringe image (mono8, mono16 or 32FC1); middle of its exposure
//   /camera/camera_info             CameraInfo camera      with each fringe image
//   /camera/texture, …/depth        Image camera           per view: texture (mono8), z in m (32FC1, NaN: none)
//   /camera/points                  PointCloud2 camera     per view: x y z (m), intensity (0 to 255), sigma (of z, m)
//   /projector/camera_info          CameraInfo projector   latched
//   /thermal/image_raw, …           Image thermal          per view: hundredths of a kelvin (16UC1) or °C (32FC1)
//   /tf_static                      TFMessage, latched     robot → camera → projector, thermal
//   /ground_truth/tf                TFMessage              per view: world → robot; only with truth
//   /ground_truth/path              Path world             of the robot; only with truth
//
// Stamps are capture times plus clock_offset_s: ROS times are positive, but simulated and device clocks begin near zero.
// The offset is 0 if the first capture time is after 1973 (a clock that counts from 1970), otherwise 10^9 s.
#pragma once

#include <memory>
#include <optional>

#include "core/io/files.h"
#include "core/io/yaml_guard.h"
#include "core/rig/dataset.h"
#include "tools/bag/bag.h"
#include "tools/rgbd.h"

namespace fringeslam::tools {

// See above; `time_s` is the first capture time.
double clock_offset_s(double time_s);
// Time in a bag of a capture time, to a nanosecond.
BagTime bag_time(double time_s, double offset_s);

// Writes a bag, which appears under its name by finish().
class BagRecorder {
 public:
  // `board_yaml` is empty if there is no board. Throws Error if the file exists and is no bag.
  BagRecorder(const std::filesystem::path& out, RigModel model, PatternSequence sequence, DatasetInfo info,
              std::string board_yaml);
  ~BagRecorder();
  // Adds a stack; with what was reconstructed from it.
  void add(const FringeStack& stack);
  void add(const RgbdView& view);
  // Folder for temporary files, to be created by the caller; finish() removes it.
  std::filesystem::path scratch() const;
  // clock_offset_s, known after the first stack.
  double offset_s() const { return offset_s_.value_or(0); }
  // Adds the true trajectory of the robot, unless empty, and completes the file.
  void finish(const Trajectory& robot);
  // Keeps what was written so far, if it cannot be finished, in a file with another name, which is returned: a bag without an
  // index, which `rosbag reindex` repairs.
  std::filesystem::path keep_unfinished() { return staged_.keep_unfinished(); }

 private:
  void begin(const FringeStack& stack);
  void add_thermal(const FringeStack& stack);
  BagTime stamp(double time_s) const;

  StagedFile staged_;
  BagWriter bag_;
  RigModel model_;
  PatternSequence sequence_;
  DatasetInfo info_;
  std::string board_yaml_;
  std::optional<double> offset_s_;  // from the first stack
};

// Writes a source's bag; `with_truth` adds the true trajectory to it. Throws Error if the source cannot provide what
// `options` ask for.
WrittenViews write_bag(Source& source, const Settings& settings, const RgbdOptions& options, bool with_truth,
                       const std::filesystem::path& out, const Common& common);

// Limits of the contents that are kept while a bag is read: a small compressed file can contain any amount.
struct BagLimits {
  size_t text_bytes = kMostYamlBytes;       // of a message
  size_t all_text_bytes = size_t{1} << 30;  // of all messages
  size_t stacks = 1'000'000, poses = 5'000'000;
};

// Replays the stacks of a bag that BagRecorder wrote.
class BagRig : public Rig {
 public:
  // Throws Error naming the file and the topic if something is missing or invalid, or exceeds the limits.
  explicit BagRig(std::filesystem::path file, const BagLimits& limits = {});
  ~BagRig() override;
  const RigModel& model() const override { return model_; }
  const PatternSequence& sequence() const { return sequence_; }
  const DatasetInfo& info() const { return info_; }
  const std::string& board_yaml() const { return board_yaml_; }
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return {file_}; }
  void recalibrate(const RigModel& calibration);
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

 private:
  struct Images;
  cv::Mat image_for(const Pinhole& lens, Images& images, const BagMessage& message) const;
  cv::Mat1f thermal_image();

  std::filesystem::path file_;
  DatasetInfo info_;
  RigModel model_;
  PatternSequence sequence_;
  std::string board_yaml_;
  double offset_s_ = 0;
  std::vector<std::string> stacks_;  // stack.yaml of each stack
  size_t next_ = 0;
  std::unique_ptr<Images> images_, thermal_;
};

// True for a bag that BagRecorder wrote, false for other bags.
bool is_our_bag(const std::vector<BagTopic>& topics);

// True for a file that begins like a bag.
bool is_bag(const std::filesystem::path& file);

// Reads the true trajectory of the camera from a bag that `render` wrote, at its times. Throws Error if it has none, or more
// poses than the limit.
Trajectory true_camera_trajectory(const std::filesystem::path& file, const BagLimits& limits = {});

// Converts an image message to CV_8UC1, CV_16UC1, CV_32FC1 or CV_8UC3 (BGR). Throws Error, which `where` begins, if its
// encoding is not supported or its size does not match its bytes.
cv::Mat image_of(const BagImage& image, const std::string& where);

}  // namespace fringeslam::tools

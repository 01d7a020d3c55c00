// SPDX-License-Identifier: Apache-2.0
#include "core/rig/dataset.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/io/files.h"
#include "core/io/staged.h"
#include "core/io/yaml.h"
#include "core/rig/rig_file.h"
#include "core/types/centikelvin.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr const char* kFormat = "fringeslam-dataset-1";

fs::path stack_folder(const fs::path& dataset, int index) { return dataset / "stacks" / stack_name(index); }

std::string image_name(size_t number, const std::string& extension) {
  char name[32];
  std::snprintf(name, sizeof name, "%02zu", number);
  return name + extension;
}

// Returns the existing .exr file (unquantised images) or else the .png file.
fs::path exr_or_png(const fs::path& stem) {
  const fs::path exr = stem.string() + ".exr";
  std::error_code ignored;
  return fs::exists(exr, ignored) ? exr : fs::path(stem.string() + ".png");
}

fs::path image_file(const fs::path& stack, size_t number) { return exr_or_png(stack / image_name(number, "")); }
fs::path thermal_file(const fs::path& stack) { return exr_or_png(stack / "thermal"); }

std::string listed(const std::vector<double>& values) {
  std::string text;
  for (size_t i = 0; i < values.size(); ++i) text += (i ? ", " : "") + to_text(values[i]);
  return text;
}

// Refuses images that the camera of rig.yaml cannot have taken: mapping them would give no depth, or a wrong one.
void check_values(const fs::path& file, const cv::Mat& image, const SensorModel& sensor) {
  const std::string bits = std::to_string(sensor.bits) + " bits of the camera in rig.yaml";
  if (image.depth() == CV_32F) {
    const auto* first = image.ptr<float>();
    if (std::none_of(first, first + image.total(), [](float value) { return std::isfinite(value); }))
      throw Error(file.string() + ": no pixel has a finite value; record or render it again");
    return;
  }
  if (image.depth() == CV_8U && sensor.bits > 8)
    throw Error(file.string() + ": has 8 bits per pixel, which does not match the " + bits);
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  if (largest > sensor.max_dn())
    throw Error(file.string() + ": has a grey value of " + to_text(largest) + ", which exceeds the " + bits);
}

}  // namespace

std::string stack_yaml(const FringeStack& stack) {
  return "timestamp_s: " + to_text(stack.timestamp_s) + "\nexposure_s: [" + listed(stack.exposure_s) +
         "]\nexposure_time_s: [" + listed(stack.exposure_time_s) + "]\n";
}

void read_stack_times(const YamlMap& map, size_t images, const Timing& timing, FringeStack& stack) {
  stack.timestamp_s = map.number("timestamp_s", {0, 1e12});
  stack.exposure_s = map.numbers("exposure_s", images, {1e-9, 1e3});
  // Older datasets lack the times; their images were taken at the camera rate.
  stack.exposure_time_s = map.has("exposure_time_s") ? map.numbers("exposure_time_s", images, {-1e12, 1e12})
                                                     : exposure_times_s(stack.timestamp_s, images, timing);
  map.finish();
  std::vector<double> sorted_s = stack.exposure_time_s;
  std::sort(sorted_s.begin(), sorted_s.end());
  if (std::adjacent_find(sorted_s.begin(), sorted_s.end()) != sorted_s.end())
    throw map.error("exposure_time_s", "exposure_time_s has the same time twice; correct the times");
  constexpr double kRounding_s = 1e-3;
  if (stack.timestamp_s < sorted_s.front() - kRounding_s || stack.timestamp_s > sorted_s.back() + kRounding_s)
    throw map.error("exposure_time_s", "exposure_time_s is from " + to_text(sorted_s.front()) + " to " +
                                           to_text(sorted_s.back()) + " s, but timestamp_s is " +
                                           to_text(stack.timestamp_s) + " s; both are on the same clock, in seconds");
}

std::optional<cv::Mat1w> centikelvin_image(const cv::Mat1f& temperature_c) {
  cv::Mat1w image(temperature_c.size());
  std::transform(temperature_c.begin(), temperature_c.end(), image.begin(),
                 [](float t) { return centikelvin(static_cast<double>(t)); });
  if (!std::equal(temperature_c.begin(), temperature_c.end(), image.begin(),
                  [](float t, uint16_t recorded) { return t == celsius(recorded); }))
    return std::nullopt;
  return image;
}

cv::Mat1f celsius_image(const cv::Mat& image, const std::string& where) {
  if (image.type() == CV_32FC1) return image;
  if (image.type() != CV_16UC1) throw Error(where + ": is not a 16-bit image in hundredths of a kelvin");
  cv::Mat1f temperature_c(image.size());
  std::transform(image.begin<uint16_t>(), image.end<uint16_t>(), temperature_c.begin(), celsius);
  return temperature_c;
}

std::string stack_name(int index) {
  char name[32];
  std::snprintf(name, sizeof name, "%06d", index);
  return name;
}

DatasetInfo read_dataset_info(const fs::path& folder) {
  const YamlMap map = YamlMap::load(folder / kDatasetFile);
  if (map.text("format") != kFormat)
    throw map.error("format", "format is not '" + std::string(kFormat) + "'; this version reads only that format");
  DatasetInfo info;
  info.name = map.text("name");
  info.seed = map.seed("seed");
  info.stacks = map.integer("stacks", {1, 1e6});
  info.has_truth = map.boolean_or("truth", false);
  info.has_thermal = map.boolean_or("thermal", false);
  info.imported = map.boolean_or("imported", false);
  info.image_times = map.boolean_or("image_times", false);
  map.finish();
  return info;
}

ReplayRig::ReplayRig(fs::path folder)
    : folder_(std::move(folder)),
      info_(read_dataset_info(folder_)),
      model_(read_rig(folder_ / "rig.yaml")),
      sequence_(read_patterns(folder_ / "patterns.yaml")) {
  for (int index = 0; index < info_.stacks; ++index) {
    for (size_t i = 0; i < sequence_.patterns.size(); ++i) {
      const fs::path file = image_file(stack_folder(folder_, index), i);
      if (!fs::exists(file))
        throw Error(file.string() + ": is missing; " + kDatasetFile + " lists " + std::to_string(info_.stacks) +
                    " stacks of " + std::to_string(sequence_.patterns.size()) + " images");
    }
    const fs::path thermal = thermal_file(stack_folder(folder_, index));
    if (info_.has_thermal && !fs::exists(thermal))
      throw Error(thermal.string() + ": is missing, although " + kDatasetFile + " declares thermal images");
  }
  if (info_.has_thermal && !model_.thermal)
    throw Error((folder_ / "rig.yaml").string() + ": has no 'thermal' section, although " + kDatasetFile +
                " declares thermal images");
}

cv::Mat1f ReplayRig::thermal_of(const fs::path& stack) const {
  const fs::path file = thermal_file(stack);
  const Pinhole& lens = model_.thermal->lens;
  const cv::Mat image = read_grey(file, ExpectedSize{{lens.width, lens.height}, "the thermal camera of rig.yaml"});
  return celsius_image(image, file.string());
}

// Indices of the recorded images that a sequence asks for.
std::vector<size_t> ReplayRig::images_of(const PatternSequence& sequence) const {
  PatternSequence same = sequence;
  same.patterns = sequence_.patterns;
  std::vector<size_t> images;
  for (size_t i = 0; i < sequence_.patterns.size() && images.size() < sequence.patterns.size(); ++i) {
    if (sequence_.patterns[i] == sequence.patterns[images.size()]) images.push_back(i);
  }
  if (!(same == sequence_) || images.empty() || images.size() < sequence.patterns.size())
    throw Error((folder_ / "patterns.yaml").string() + ": the dataset was recorded with a different pattern sequence");
  return images;
}

std::optional<FringeStack> ReplayRig::capture(const PatternSequence& sequence) {
  const std::vector<size_t> wanted = images_of(sequence);
  if (next_ >= info_.stacks) return std::nullopt;
  const fs::path folder = stack_folder(folder_, next_);
  const YamlMap meta = YamlMap::load(folder / "stack.yaml");
  FringeStack stack;
  stack.index = next_;
  stack.patterns = sequence;
  read_stack_times(meta, sequence_.patterns.size(), model_.timing, stack);
  const std::vector<double> exposures = std::move(stack.exposure_s), times = std::move(stack.exposure_time_s);
  stack.exposure_s.clear();
  stack.exposure_time_s.clear();
  for (const size_t i : wanted) {
    const fs::path file = image_file(folder, i);
    stack.exposure_s.push_back(exposures[i]);
    stack.exposure_time_s.push_back(times[i]);
    cv::Mat image =
        read_grey(file, ExpectedSize{{model_.camera.width, model_.camera.height}, "the camera of rig.yaml"});
    check_values(file, image, model_.sensor);
    if (!stack.images.empty() && image.type() != stack.images.front().type())
      throw Error(file.string() + ": has a different pixel type than the first image of its stack");
    stack.images.push_back(std::move(image));
  }
  if (info_.has_thermal) stack.thermal_c = thermal_of(folder);
  ++next_;
  return stack;
}

void ReplayRig::recalibrate(const RigModel& calibration) {
  try {
    model_ = with_calibration(model_, calibration);
  } catch (const Error& e) {
    throw Error(folder_.string() + ": " + e.what());
  }
}

RecordingRig::RecordingRig(Rig& inner, fs::path folder, Durable durable)
    : inner_(inner), folder_(std::move(folder)), durable_(durable) {
  for (const fs::path& input : inner_.inputs()) {
    std::error_code differs;
    if (fs::equivalent(folder_, input, differs) && !differs)
      throw Error(folder_.string() + ": is the input of the rig to be recorded; choose another folder");
  }
  write_text(folder_ / "rig.yaml", to_yaml(inner_.model()));
}

namespace {

void write_thermal(const fs::path& folder, const cv::Mat1f& temperature_c) {
  if (const auto recorded = centikelvin_image(temperature_c)) return write_png(folder / "thermal.png", *recorded);
  write_exr(folder / "thermal.exr", {{"Y", temperature_c}});
}

void write_stack(const fs::path& folder, const FringeStack& stack) {
  fs::create_directories(folder);
  if (!stack.thermal_c.empty()) write_thermal(folder, stack.thermal_c);
  for (size_t i = 0; i < stack.images.size(); ++i) {
    const cv::Mat& image = stack.images[i];
    if (image.type() == CV_32FC1)
      write_exr(folder / image_name(i, ".exr"), {{"Y", image}});
    else
      write_png(folder / image_name(i, ".png"), image);
  }
  write_text(folder / "stack.yaml", stack_yaml(stack));
}

}  // namespace

std::optional<FringeStack> RecordingRig::capture(const PatternSequence& sequence) {
  if (!sequence_) write_text(folder_ / "patterns.yaml", to_yaml(sequence));
  if (sequence_ && !(*sequence_ == sequence))
    throw Error(folder_.string() + ": a dataset contains only one pattern sequence");
  sequence_ = sequence;
  auto stack = inner_.capture(sequence);
  if (!stack) return stack;
  if (stacks_ > 0 && has_thermal_ == stack->thermal_c.empty())
    throw Error(folder_.string() + ": a dataset has a thermal image for every stack or for none");
  has_thermal_ = !stack->thermal_c.empty();

  const fs::path folder = stack_folder(folder_, stacks_);
  try {
    write_stack(folder, *stack);
    if (durable_ == Durable::yes) {
      sync_folder(folder);
      sync_entry(folder.parent_path());
    }
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(folder, ignored);  // do not leave a partial stack
    throw;
  }
  ++stacks_;
  return stack;
}

void RecordingRig::finish(const std::string& name, uint64_t seed, bool has_truth, bool imported, bool image_times) {
  const std::string text = std::string("format: ") + kFormat + "\nname: " + yaml_quoted(name) +
                           "\nseed: " + std::to_string(seed) + "\nstacks: " + std::to_string(stacks_) +
                           "\ntruth: " + (has_truth ? "true" : "false") + "\n" +
                           (has_thermal_ ? "thermal: true\n" : "") + (imported ? "imported: true\n" : "") +
                           (image_times ? "image_times: true\n" : "");
  // Replaced as a whole, so that a growing dataset is valid at any time.
  if (durable_ == Durable::no) return write_text(folder_ / kDatasetFile, text);
  for (const char* file : {"rig.yaml", "patterns.yaml"}) sync_entry(folder_ / file);
  StagedFile file(folder_ / kDatasetFile);
  write_text(file.path(), text);
  file.commit();
  sync_entry(fs::absolute(folder_).parent_path());
}

}  // namespace fringeslam

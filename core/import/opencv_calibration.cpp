// SPDX-License-Identifier: Apache-2.0
#include "core/import/opencv_calibration.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/core/persistence.hpp>

#include "core/base/limited_child.h"
#include "core/io/input_file.h"
#include "core/io/packed_values.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

// Tolerated deviation from orthonormality; files with four decimal places deviate this much.
constexpr double kRotationRounding = 1e-3;
constexpr size_t kDistortionTerms = 5;

using Names = std::vector<std::string>;

const Names kCameraMatrix = {"camera_matrix", "cameraMatrix",    "camera_K", "cam_K", "cam_int", "M1", "K1",
                             "cameraMatrix1", "camera_matrix_1", "K"};
const Names kCameraDistortion = {"camera_distortion",
                                 "cameraDistortion",
                                 "distortion_coefficients",
                                 "dist_coeffs",
                                 "distCoeffs",
                                 "cam_kc",
                                 "cam_dist",
                                 "D1",
                                 "distCoeffs1",
                                 "dist_coeffs_1"};
const Names kProjectorMatrix = {"projector_matrix", "projectorMatrix", "projector_K", "proj_K", "proj_int", "M2", "K2",
                                "cameraMatrix2",    "camera_matrix_2", "M4"};
const Names kProjectorDistortion = {"projector_distortion",
                                    "projectorDistortion",
                                    "proj_dist_coeffs",
                                    "proj_kc",
                                    "proj_dist",
                                    "D2",
                                    "distCoeffs2",
                                    "dist_coeffs_2",
                                    "D4"};
const Names kRotation = {"R", "rotation", "rotation_matrix", "Rlp"};
const Names kTranslation = {"T", "t", "translation", "translation_vector", "Tlp"};
const Names kCameraSize = {"camera_size", "cameraSize", "image_size", "imageSize"};
const std::vector<std::pair<std::string, std::string>> kCameraSizePairs = {{"frameWidth", "frameHeight"},
                                                                           {"image_width", "image_height"}};
const std::vector<std::pair<std::string, std::string>> kProjectorSizePairs = {
    {"screenResX", "screenResY"}, {"projector_width", "projector_height"}, {"proj_width", "proj_height"}};
const Names kProjectorSize = {"projector_size", "projectorSize"};

// Suppresses the messages that OpenCV prints on standard error before it throws.
class QuietOpenCv {
 public:
  QuietOpenCv()
      : previous_(cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; })) {}
  ~QuietOpenCv() { cv::redirectError(previous_); }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::ErrorCallback previous_;
};

// A file as OpenCV's parser returns it, not validated, and the bytes by which a child process returns it.
enum class EntryKind : uint32_t { empty, numbers, other };
struct RawEntry {
  std::string name;
  EntryKind kind = EntryKind::other;
  std::vector<double> values;  // row-major
};
struct RawFile {
  uint32_t is_storage = 0;  // nonzero if OpenCV reads it
  std::vector<RawEntry> entries;
};
struct RawFiles {
  std::vector<RawFile> files;
};

template <class Pipe, Either<RawEntry> Part>
void exchange(Pipe& pipe, Part& entry) {
  pipe.text(entry.name);
  pipe.value(entry.kind);
  pipe.list(entry.values);
}

template <class Pipe, Either<RawFile> Part>
void exchange(Pipe& pipe, Part& file) {
  pipe.value(file.is_storage);
  pipe.items(file.entries);
}

template <class Pipe, Either<RawFiles> Part>
void exchange(Pipe& pipe, Part& files) {
  pipe.items(files.files);
}

void append_numbers(const cv::FileNode& node, std::vector<double>& values) {
  if (node.isMap()) {  // !!opencv-matrix
    // OpenCV allocates what the file declares.
    const cv::FileNode data = node["data"], rows = node["rows"], cols = node["cols"];
    if (!rows.isInt() || !cols.isInt() || rows.real() * cols.real() > static_cast<double>(data.size()))
      throw Error("is not a matrix");
    cv::Mat matrix;
    node >> matrix;
    cv::Mat1d numbers;
    matrix.reshape(1, 1).convertTo(numbers, CV_64F);
    values.insert(values.end(), numbers.begin(), numbers.end());
  } else if (node.isSeq()) {
    for (const auto& element : node) append_numbers(element, values);
  } else if (node.isInt() || node.isReal()) {
    values.push_back(node.real());
  } else {
    throw Error("is not a number");
  }
}

RawEntry raw_entry(const cv::FileNode& node) {
  RawEntry entry{node.name(), EntryKind::numbers, {}};
  if (node.isNone()) {
    entry.kind = EntryKind::empty;
    return entry;
  }
  try {
    append_numbers(node, entry.values);
  } catch (const std::exception&) {
    entry.kind = EntryKind::other;
  }
  return entry;
}

RawFile raw_file(const std::string& content) {
  RawFile file;
  cv::FileStorage storage;
  try {
    storage.open(content, cv::FileStorage::READ | cv::FileStorage::MEMORY);
  } catch (const cv::Exception&) {
  }
  if (!storage.isOpened()) return file;
  // A file may consist of several YAML documents.
  for (int document = 0;; ++document) {
    const cv::FileNode root = storage.root(document);
    if (root.empty()) break;
    if (!root.isMap()) return {};
    for (const auto& node : root) file.entries.push_back(raw_entry(node));
    file.is_storage = 1;
  }
  return file;
}

RawFiles raw_files(const std::vector<std::string>& contents) {
  const QuietOpenCv quiet;
  RawFiles raw;
  for (const std::string& content : contents) raw.files.push_back(raw_file(content));
  return raw;
}

// Numbers of one entry, in row-major order.
struct StorageNode {
  std::string where;  // "calibration.yml: M1"
  std::vector<double> values;

  Error error(const std::string& message) const { return Error(where + " " + message); }
};

std::string joined(const Names& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

class Storage {
 public:
  Storage(const std::vector<fs::path>& paths, RawFiles raw) {
    if (paths.empty()) throw Error("no calibration file was specified");
    for (size_t i = 0; i < paths.size(); ++i) {
      if (i >= raw.files.size() || !raw.files[i].is_storage)
        throw Error(paths[i].string() + ": is not an OpenCV file (cv::FileStorage YAML, XML or JSON)");
      files_.push_back({paths[i], std::move(raw.files[i].entries)});
    }
  }

  // Finds the named entry, or the first common name that exists in a file; null if there is none.
  std::unique_ptr<StorageNode> find(const std::string& named, const Names& usual) const {
    if (!named.empty()) return find_named(named);
    for (const std::string& name : usual) {
      if (auto entry = find_in_all(name)) return entry;
    }
    return nullptr;
  }

  StorageNode require(const std::string& what, const std::string& named, const Names& usual) const {
    if (const auto entry = find(named, usual)) return *entry;
    const std::string tried = named.empty() ? "none of " + joined(usual) : "no '" + named + "'";
    throw Error(all_names() + ": " + tried + " for the " + what + "; the entries are " + contents() +
                (named.empty() ? ": specify which of them it is" : ""));
  }

 private:
  struct File {
    fs::path path;
    std::vector<RawEntry> entries;
  };

  std::unique_ptr<StorageNode> find_named(const std::string& named) const {
    for (const File& file : files_) {
      const std::string prefix = file.path.filename().string() + ":";
      if (named.starts_with(prefix)) return find_in(file, named.substr(prefix.size()));
    }
    return find_in_all(named);
  }

  std::unique_ptr<StorageNode> find_in_all(const std::string& name) const {
    std::unique_ptr<StorageNode> found;
    for (const File& file : files_) {
      auto entry = find_in(file, name);
      if (entry && found)
        throw entry->error("also exists in another file; specify the one to use as " + file.path.filename().string() +
                           ":" + name);
      if (entry) found = std::move(entry);
    }
    return found;
  }

  static std::unique_ptr<StorageNode> find_in(const File& file, const std::string& name) {
    const auto named =
        std::find_if(file.entries.begin(), file.entries.end(), [&](const RawEntry& e) { return e.name == name; });
    if (named == file.entries.end() || named->kind == EntryKind::empty) return nullptr;
    auto entry = std::make_unique<StorageNode>(StorageNode{file.path.string() + ": " + name, named->values});
    if (named->kind != EntryKind::numbers) throw entry->error("is not a matrix or list of numbers");
    for (const double value : entry->values) {
      if (!std::isfinite(value)) throw entry->error("contains a non-finite number");
    }
    return entry;
  }

  std::string all_names() const {
    Names names;
    for (const File& file : files_) names.push_back(file.path.string());
    return joined(names);
  }

  std::string contents() const {
    Names names;
    for (const File& file : files_) {
      for (const RawEntry& entry : file.entries) names.push_back(entry.name);
    }
    return joined(names);
  }

  std::vector<File> files_;
};

void read_matrix(const StorageNode& entry, Pinhole& device) {
  const std::vector<double>& m = entry.values;
  if (m.size() != 9) throw entry.error("must be a 3x3 camera matrix");
  if (m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1 || m[0] <= 0 || m[4] <= 0)
    throw entry.error("must have the form [fx 0 cx; 0 fy cy; 0 0 1] with positive fx and fy");
  if (m[1] != 0)
    throw entry.error("has a skew of " + to_text(m[1]) + " px, which is not modelled; calibrate without skew");
  device.fx = m[0], device.fy = m[4], device.cx = m[2], device.cy = m[5];
}

void read_distortion(const StorageNode& entry, Pinhole& device) {
  std::vector<double> d = entry.values;
  if (d.size() != 4 && d.size() != 5 && d.size() != 8 && d.size() != 12 && d.size() != 14)
    throw entry.error("must be 4, 5, 8, 12 or 14 distortion coefficients, but has " + std::to_string(d.size()));
  for (size_t i = kDistortionTerms; i < d.size(); ++i) {
    if (d[i] != 0)
      throw entry.error(
          "has distortion terms beyond k1 k2 p1 p2 k3, which are not modelled; calibrate without "
          "CALIB_RATIONAL_MODEL, CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL");
  }
  d.resize(kDistortionTerms);
  device.distortion = {d[0], d[1], d[2], d[3], d[4]};
}

Eigen::Matrix3d read_rotation(const StorageNode& entry) {
  const std::vector<double>& r = entry.values;
  if (r.size() == 3) return rotation_exp({r[0], r[1], r[2]});
  if (r.size() != 9) throw entry.error("must be a 3x3 rotation or a Rodrigues vector of 3");
  const Eigen::Matrix3d rotation = Eigen::Matrix3d(r.data()).transpose();  // Eigen stores by column
  const double defect = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm();
  if (defect > kRotationRounding || rotation.determinant() < 0)
    throw entry.error("is not a right-handed rotation (it deviates from orthonormality by " + to_text(defect) + ")");
  return orthonormalised({rotation, Eigen::Vector3d::Zero()}).rotation;
}

Eigen::Vector3d read_translation(const StorageNode& entry, double unit_m) {
  if (entry.values.size() != 3) throw entry.error("must be a vector of 3");
  return unit_m * Eigen::Vector3d(entry.values.data());
}

void read_size(const StorageNode* entry, Pinhole& device) {
  if (!entry) return;
  constexpr double kMaxSize = 16384;
  const std::vector<double>& size = entry->values;
  const auto is_length = [](double v) { return v >= 1 && v <= kMaxSize && v == std::floor(v); };
  if (size.size() != 2 || !is_length(size[0]) || !is_length(size[1]))
    throw entry->error("must be a width and a height in px");
  device.width = static_cast<int>(size[0]), device.height = static_cast<int>(size[1]);
}

// Two entries that hold width and height.
using SizeEntries = std::pair<std::string, std::string>;

std::unique_ptr<StorageNode> find_size(const Storage& storage, const std::string& named, const Names& usual,
                                       const std::vector<SizeEntries>& usual_pairs) {
  if (auto entry = storage.find(named, usual)) return entry;
  for (const auto& [width, height] : usual_pairs) {
    auto entry = storage.find(width, {});
    const auto second = storage.find(height, {});
    if (!entry || !second) continue;
    entry->values.insert(entry->values.end(), second->values.begin(), second->values.end());
    return entry;
  }
  return nullptr;
}

Pinhole read_device(const Storage& storage, const std::string& what, const std::string& matrix,
                    const Names& usual_matrix, const std::string& distortion, const Names& usual_distortion,
                    const std::string& size, const Names& usual_size, const std::vector<SizeEntries>& usual_pairs) {
  Pinhole device;
  read_matrix(storage.require(what + " matrix", matrix, usual_matrix), device);
  if (distortion != "none")
    read_distortion(
        storage.require(what + " distortion (or `" + what + "_distortion: none`)", distortion, usual_distortion),
        device);
  if (!size.empty()) storage.require(what + " size", size, usual_size);
  read_size(find_size(storage, size, usual_size, usual_pairs).get(), device);
  return device;
}

RigCalibration calibration_of(const CalibrationFiles& source, RawFiles raw) {
  const Storage storage(source.files, std::move(raw));
  const CalibrationNames& names = source.names;
  RigCalibration calibration;
  calibration.camera = read_device(storage, "camera", names.camera_matrix, kCameraMatrix, names.camera_distortion,
                                   kCameraDistortion, names.camera_size, kCameraSize, kCameraSizePairs);
  calibration.projector =
      read_device(storage, "projector", names.projector_matrix, kProjectorMatrix, names.projector_distortion,
                  kProjectorDistortion, names.projector_size, kProjectorSize, kProjectorSizePairs);
  const Pose pose{read_rotation(storage.require("rotation", names.rotation, kRotation)),
                  read_translation(storage.require("translation", names.translation, kTranslation), source.unit_m)};
  calibration.projector_from_camera = source.projector_from_camera ? pose : pose.inverse();
  return calibration;
}

constexpr uint64_t kMostCalibrationBytes = 16 * kMebibyte;

// Parses the files in a restricted child process.
RawFiles parsed_by_child(const std::vector<fs::path>& files) {
  constexpr ChildLimits kLimits{10, 0.5, ChildReads::nothing};
  std::vector<std::string> contents;
  for (const fs::path& file : files) contents.push_back(read_input(file, kMostCalibrationBytes));
  const auto [end, bytes] = answer_of_child(kLimits, [&]() -> std::string {
    try {
      return packed_values(raw_files(contents));
    } catch (const std::exception&) {
      return "?";
    }
  });
  std::string why = end == ChildEnd::not_started ? "no process can be started for it"
                    : end == ChildEnd::too_slow  ? "that takes too long; the file is damaged: export it again"
                                                 : "the reader crashed; the file is damaged: export it again";
  try {
    if (end == ChildEnd::answered) return unpacked_values<RawFiles>(bytes);
  } catch (const Error& e) {
    why = e.what() + std::string("; the file is damaged: export it again");
  }
  throw Error(files.front().string() + ": cannot be read as an OpenCV file: " + why);
}

}  // namespace

RigCalibration read_opencv_calibration(const CalibrationFiles& source) {
  if (source.files.empty()) return calibration_of(source, {});  // refuses
  return calibration_of(source, parsed_by_child(source.files));
}

}  // namespace fringeslam

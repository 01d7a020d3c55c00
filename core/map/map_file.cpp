// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_file.h"

#include <zstd.h>

#include <array>
#include <cmath>
#include <cstring>

#include "core/base/append_bytes.h"
#include "core/base/fnv.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr std::string_view kMagic = "FringeSLAM map 2\n", kAnyMagic = "FringeSLAM map ";
constexpr int kDescriptor = 128;

// A single description of the content serves both directions: `Archive` is a Writer or a Reader.

class Writer {
 public:
  static constexpr bool kReads = false;
  template <class Number>
  void number(const Number& value) {
    append_bytes(bytes_, value);
  }
  template <class Pixel>
  void image(const cv::Mat_<Pixel>& image, cv::Size) {
    for (int row = 0; row < image.rows; ++row)
      bytes_.append(reinterpret_cast<const char*>(image[row]), static_cast<size_t>(image.cols) * sizeof(Pixel));
  }
  template <class Item, class Body>
  void list(const std::vector<Item>& items, const Body& body) {
    append_bytes(bytes_, static_cast<uint32_t>(items.size()));
    for (const Item& item : items) body(item);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

class Reader {
 public:
  static constexpr bool kReads = true;
  Reader(std::string_view bytes, std::string where) : bytes_(bytes), where_(std::move(where)) {}
  template <class Number>
  void number(Number& value) {
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
  }
  template <class Pixel>
  void image(cv::Mat_<Pixel>& image, cv::Size size) {
    const std::string_view raw = take(static_cast<size_t>(size.area()) * sizeof(Pixel));
    image.create(size);
    if (!raw.empty()) std::memcpy(image.data, raw.data(), raw.size());
  }
  template <class Item, class Body>
  void list(std::vector<Item>& items, const Body& body) {
    uint32_t count = 0;
    number(count);
    require(count <= bytes_.size(), "a list is longer than the file");
    items.resize(count);
    for (Item& item : items) body(item);
  }
  void require(bool holds, const std::string& what) const {
    if (!holds) throw Error(where_ + ": is damaged (" + what + "); create the map again");
  }
  void finish() const { require(bytes_.empty(), "it has trailing data"); }

 private:
  std::string_view take(size_t size) {
    require(size <= bytes_.size(), "it is truncated");
    const std::string_view taken = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return taken;
  }
  std::string_view bytes_;
  std::string where_;
};

template <class Archive, class Matrix>
void matrix(Archive& archive, Matrix& m) {
  for (Eigen::Index i = 0; i < m.size(); ++i) archive.number(m.data()[i]);
  if constexpr (Archive::kReads) archive.require(m.allFinite(), "a number is not finite");
}

template <class Archive, class P>
void pose(Archive& archive, P& p) {
  matrix(archive, p.rotation);
  matrix(archive, p.translation);
  if constexpr (Archive::kReads)
    archive.require((p.rotation * p.rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6,
                    "a rotation matrix is not orthonormal");
}

template <class Archive, class Index>
void index_below(Archive& archive, Index& index, size_t limit) {
  archive.number(index);
  if constexpr (Archive::kReads)
    archive.require(index >= 0 && static_cast<size_t>(index) < limit, "an index is out of range");
}

template <class Archive, class F>
void frame(Archive& archive, F& f, cv::Size size) {
  archive.number(f.index);
  archive.number(f.timestamp_s);
  archive.image(f.depth_m, size);
  archive.image(f.sigma, size);
  archive.image(f.normals, size);
  archive.image(f.texture, size);
}

// The parts of landmarks that re-identification needs; how they were detected is not stored.
template <class Archive, class L>
void landmarks(Archive& archive, L& l) {
  archive.list(l.keypoints.keypoints, [&](auto& k) {
    matrix(archive, k.pixel);
    archive.number(k.scale);
    archive.number(k.angle_rad);
    archive.number(k.strength);
    matrix(archive, k.point_m);
    matrix(archive, k.covariance_m2);
  });
  const size_t keypoints = l.keypoints.keypoints.size();
  archive.image(l.keypoints.descriptors, cv::Size(kDescriptor, static_cast<int>(keypoints)));
  archive.number(l.keypoints.detected);
  archive.list(l.landmarks, [&](auto& landmark) {
    archive.list(landmark.outline, [&](auto& p) {
      archive.number(p.x);
      archive.number(p.y);
    });
    archive.list(landmark.keypoints, [&](auto& k) { index_below(archive, k, keypoints); });
  });
}

template <class Archive, class Keyframes, class Frames, class Links>
void content(Archive& archive, Keyframes& keyframes, Frames& frames, Links& links, cv::Size size) {
  archive.list(keyframes, [&](auto& k) {
    archive.number(k.index);
    archive.number(k.timestamp_s);
    pose(archive, k.world_from_camera);
    landmarks(archive, k.landmarks);
    frame(archive, k.frame, size);
  });
  archive.list(frames, [&](auto& f) {
    index_below(archive, f.keyframe, keyframes.size());
    pose(archive, f.keyframe_from_camera);
    auto& own = keyframes[static_cast<size_t>(f.keyframe)].frame;
    uint8_t is_own = f.frame.depth_m.data == own.depth_m.data && f.frame.depth_m.data != nullptr;
    archive.number(is_own);
    if (!is_own)
      frame(archive, f.frame, size);
    else if constexpr (Archive::kReads)
      f.frame = own;
  });
  archive.list(links, [&](auto& l) {
    index_below(archive, l.from, keyframes.size());
    index_below(archive, l.to, keyframes.size());
    pose(archive, l.from_from_to);
    matrix(archive, l.information);
    archive.number(l.loop);
  });
}

using CameraNumbers = std::array<double, 11>;

CameraNumbers numbers_of(const Pinhole& c) {
  const Distortion& d = c.distortion;
  return {double(c.width), double(c.height), c.fx, c.fy, c.cx, c.cy, d.k1, d.k2, d.p1, d.p2, d.k3};
}

}  // namespace

std::string to_bytes(const KeyframeMap& map) {
  Writer writer;
  for (const double number : numbers_of(map.rig().camera)) writer.number(number);
  const cv::Size size(map.rig().camera.width, map.rig().camera.height);
  content(writer, map.keyframes(), map.frames(), map.links(), size);
  const std::string& plain = writer.bytes();
  std::string packed(ZSTD_compressBound(plain.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), plain.data(), plain.size(), 1));

  std::string bytes(kMagic);
  append_bytes(bytes, static_cast<uint64_t>(plain.size()));
  append_bytes(bytes, fnv1a(packed));
  return bytes + packed;
}

KeyframeMap map_from_bytes(std::string_view bytes, const std::string& where, const RigModel& rig,
                           const MappingOptions& options) {
  if (!bytes.starts_with(kAnyMagic)) throw Error(where + ": is not a map; use a file written by `run --save-map`");
  if (!bytes.starts_with(kMagic)) throw Error(where + ": is a map of another format version; create the map again");
  Reader header(bytes.substr(kMagic.size()), where);
  uint64_t size = 0, sum = 0;
  header.number(size);
  header.number(sum);
  const std::string_view packed = bytes.substr(kMagic.size() + sizeof size + sizeof sum);
  header.require(fnv1a(packed) == sum, "its checksum is wrong");
  constexpr uint64_t kMostRatio = 4096;  // guards against forged sizes that would exhaust the memory
  header.require(size <= kMostRatio * packed.size(), "its size is wrong");
  header.require(ZSTD_getFrameContentSize(packed.data(), packed.size()) == size, "its size is wrong");
  std::string plain(size, '\0');
  header.require(ZSTD_decompress(plain.data(), plain.size(), packed.data(), packed.size()) == size,
                 "it cannot be decompressed");

  Reader reader(plain, where);
  for (const double expected : numbers_of(rig.camera)) {
    double number = 0;
    reader.number(number);
    if (number != expected)
      throw Error(where + ": was made with another camera than that of rig '" + rig.name + "'; use the rig of the map");
  }
  std::vector<Keyframe> keyframes;
  std::vector<MapFrame> frames;
  std::vector<PoseEdge> links;
  content(reader, keyframes, frames, links, cv::Size(rig.camera.width, rig.camera.height));
  reader.finish();
  if (keyframes.empty()) throw Error(where + ": contains no keyframe; create the map again");
  KeyframeMap map(rig, options);
  map.restore(std::move(keyframes), std::move(frames), std::move(links));
  return map;
}

}  // namespace fringeslam

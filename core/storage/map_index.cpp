// SPDX-License-Identifier: Apache-2.0
#include "core/storage/map_index.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include "core/base/append_bytes.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr int kDescriptor = 128, kMostSide = 16384;
constexpr std::string_view kEnd = "map end\n";
constexpr uint64_t kTrailerBytes = 3 * sizeof(uint64_t) + kEnd.size();

// A single description of the content serves both directions: `Archive` is a Writer or a Reader.

class Writer {
 public:
  static constexpr bool kReads = false;
  template <class Number>
  void number(const Number& value) {
    append_bytes(bytes_, value);
  }
  template <class Item, class Body>
  void list(const std::vector<Item>& items, size_t, const Body& body) {
    append_bytes(bytes_, static_cast<uint32_t>(items.size()));
    for (const Item& item : items) body(item);
  }
  void align() { bytes_.resize(aligned(bytes_.size()), '\0'); }
  std::string& bytes() { return bytes_; }

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
  // Each item takes at least `least_bytes`; guards against forged counts that would exhaust the memory.
  template <class Item, class Body>
  void list(std::vector<Item>& items, size_t least_bytes, const Body& body) {
    uint32_t count = 0;
    number(count);
    require(count <= (bytes_.size() - at_) / least_bytes, "a list is longer than the file");
    items.resize(count);
    for (Item& item : items) body(item);
  }
  void align() { (void)take(static_cast<size_t>(aligned(at_)) - at_); }
  std::string_view take(size_t size) {
    require(size <= bytes_.size() - at_, "it is truncated");
    const std::string_view taken = bytes_.substr(at_, size);
    at_ += size;
    return taken;
  }
  void require(bool holds, const char* what) const {
    if (!holds) throw Error(where_ + ": is damaged (" + what + "); create the map again");
  }
  void finish() const { require(at_ == bytes_.size(), "it has trailing data"); }
  size_t position() const { return at_; }

 private:
  std::string_view bytes_;
  size_t at_ = 0;
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

// Returns true if no eigenvalue is negative by more than rounding.
template <class Matrix>
bool is_positive(const Matrix& m) {
  const Matrix symmetric = 0.5 * (m + m.transpose());
  return symmetric_eigen(symmetric).values.minCoeff() >= -1e-9 * m.cwiseAbs().maxCoeff();
}

// Archives the lower triangle of a covariance. When it is read, it must be positive semidefinite up to rounding.
template <class Archive, class Matrix>
void covariance(Archive& archive, Matrix& m) {
  for (Eigen::Index col = 0; col < m.cols(); ++col) {
    for (Eigen::Index row = col; row < m.rows(); ++row) {
      archive.number(m(row, col));
      if constexpr (Archive::kReads) m(col, row) = m(row, col);
    }
  }
  if constexpr (Archive::kReads) {
    archive.require(m.allFinite(), "a number is not finite");
    archive.require((m.diagonal().array() >= 0).all(), "a variance is negative");
    archive.require(is_positive(m), "a covariance has a negative eigenvalue");
  }
}

template <class Archive, class Bool>
void flag(Archive& archive, Bool& value) {
  uint8_t number = value;
  archive.number(number);
  if constexpr (Archive::kReads) {
    archive.require(number <= 1, "a number is out of range");
    value = number != 0;
  }
}

template <class Archive, class Index>
void index_below(Archive& archive, Index& index, size_t limit) {
  archive.number(index);
  if constexpr (Archive::kReads)
    archive.require(index >= 0 && static_cast<size_t>(index) < limit, "an index is out of range");
}

struct Bounds {
  uint64_t parts_end = 0;
  int most_files = 1;
};

template <class Archive, class Part>
void part(Archive& archive, Part& p, const Bounds& bounds) {
  archive.number(p.offset);
  archive.number(p.size);
  archive.number(p.checksum);
  archive.number(p.file);
  if constexpr (Archive::kReads) {
    archive.require(p.file < bounds.most_files, "an index is out of range");
    archive.require(p.offset >= kMapAlignment && p.offset % kMapAlignment == 0 && p.offset <= INT64_MAX,
                    "a part is misplaced");
    archive.require(p.size <= INT64_MAX - p.offset, "a part is misplaced");
    archive.require(p.file > 0 || p.offset + p.size <= bounds.parts_end, "a part is misplaced");
  }
}

// Motion of a keyframe; most keyframes are taken at rest.
template <class Archive, class Motion>
void motion(Archive& archive, Motion& m) {
  flag(archive, m.doubtful);
  bool moved = !m.covariance.isZero(0);
  flag(archive, moved);
  if (moved) covariance(archive, m.covariance);
}

constexpr size_t kPoseBytes = 12 * sizeof(double), kPartBytes = 3 * sizeof(uint64_t) + 1;

template <class Archive, class Index>
void content(Archive& archive, Index& index, const Bounds& bounds) {
  for (auto& number : index.camera) archive.number(number);
  uint64_t frame_bytes = 0;
  if constexpr (Archive::kReads) {
    for (const double side : {index.camera[0], index.camera[1]})
      archive.require(side >= 1 && side <= kMostSide && side == std::floor(side), "the size of its images is wrong");
    frame_bytes = FrameLayout(index.image_size()).bytes;
  }
  const auto images = [&](auto& place) {
    part(archive, place, bounds);
    if constexpr (Archive::kReads) archive.require(place.size == frame_bytes, "a part has a wrong size");
  };
  constexpr size_t kHeadBytes = sizeof(int) + sizeof(double) + kPoseBytes;
  archive.list(index.keyframes, kHeadBytes + 2 + 3 * kPartBytes, [&](auto& k) {
    archive.number(k.index);
    archive.number(k.timestamp_s);
    pose(archive, k.world_from_camera);
    motion(archive, k.motion);
    images(k.images);
    part(archive, k.landmarks, bounds);
    part(archive, k.digest, bounds);
  });
  archive.list(index.frames, kHeadBytes + sizeof(int) + 1, [&](auto& f) {
    index_below(archive, f.keyframe, index.keyframes.size());
    pose(archive, f.keyframe_from_camera);
    flag(archive, f.own);
    archive.number(f.index);
    archive.number(f.timestamp_s);
    if (!f.own)
      images(f.images);
    else if constexpr (Archive::kReads)
      f.images = index.keyframes[static_cast<size_t>(f.keyframe)].images;
  });
  archive.list(index.links, 2 * sizeof(int) + kPoseBytes + 36 * sizeof(double) + 1, [&](auto& l) {
    index_below(archive, l.from, index.keyframes.size());
    index_below(archive, l.to, index.keyframes.size());
    pose(archive, l.from_from_to);
    matrix(archive, l.information);
    if constexpr (Archive::kReads) {
      archive.require(l.from != l.to, "a link joins a keyframe with itself");
      archive.require((l.information - l.information.transpose()).isZero(1e-9 * l.information.cwiseAbs().maxCoeff()),
                      "the information of a link is not symmetric");
      archive.require(is_positive(l.information), "the information of a link has a negative eigenvalue");
    }
    flag(archive, l.loop);
  });
}

template <class Archive, class List>
void keypoints_of(Archive& archive, List& list) {
  archive.list(list, 17 * sizeof(double), [&](auto& k) {
    matrix(archive, k.pixel);
    archive.number(k.scale);
    archive.number(k.angle_rad);
    archive.number(k.strength);
    matrix(archive, k.point_m);
    matrix(archive, k.covariance_m2);
  });
}

template <class Archive, class List>
void indices_below(Archive& archive, List& list, size_t limit) {
  archive.list(list, sizeof(int), [&](auto& i) { index_below(archive, i, limit); });
}

template <class Archive, class D>
void digest_of_view(Archive& archive, D& d) {
  archive.number(d.keypoints);
  if constexpr (Archive::kReads) archive.require(d.keypoints >= 0, "a number is out of range");
  const auto keypoints = static_cast<size_t>(d.keypoints);
  archive.list(d.strongest, sizeof(uint32_t), [&](auto& own) { indices_below(archive, own, keypoints); });
  indices_below(archive, d.indices, keypoints);
  keypoints_of(archive, d.details);
  indices_below(archive, d.place, keypoints);
  indices_below(archive, d.owners, d.strongest.size());
  indices_below(archive, d.starts, d.owners.size() + 1);
  archive.align();
  if constexpr (Archive::kReads) {
    const size_t count = d.indices.size();
    archive.require(d.details.size() == count && d.place.size() == count && d.starts.size() == count + 1,
                    "a list has a wrong length");
    archive.require(
        std::is_sorted(d.starts.begin(), d.starts.end()) &&
            std::adjacent_find(d.indices.begin(), d.indices.end(), std::greater_equal<>()) == d.indices.end(),
        "a list is not sorted");
    for (const std::vector<int>& own : d.strongest) {
      for (const int k : own)
        archive.require(std::binary_search(d.indices.begin(), d.indices.end(), k), "an index is out of range");
    }
  }
}

template <class Archive, class L>
void landmarks(Archive& archive, L& l) {
  archive.number(l.keypoints.detected);
  keypoints_of(archive, l.keypoints.keypoints);
  const size_t keypoints = l.keypoints.keypoints.size();
  archive.list(l.landmarks, 2 * sizeof(uint32_t), [&](auto& landmark) {
    archive.list(landmark.outline, 2 * sizeof(int), [&](auto& p) {
      archive.number(p.x);
      archive.number(p.y);
    });
    archive.list(landmark.keypoints, sizeof(int), [&](auto& k) { index_below(archive, k, keypoints); });
  });
  archive.align();
}

// Returns a part: what `write` writes, then descriptors.
template <class Write, class Pixel>
std::string with_descriptors(const Write& write, const cv::Mat_<Pixel>& descriptors) {
  Writer writer;
  write(writer);
  for (int row = 0; row < descriptors.rows; ++row)
    writer.bytes().append(reinterpret_cast<const char*>(descriptors[row]), kDescriptor * sizeof(Pixel));
  return std::move(writer.bytes());
}

// Checks a part and reads it by `read`, which returns the number of the descriptors that follow. Returns these.
template <class Pixel, class Read>
cv::Mat_<Pixel> descriptors_of(const MappedFile& file, const FilePart& part, const std::string& where,
                               const Read& read) {
  const std::string_view bytes = file.bytes().substr(part.offset, part.size);
  Reader reader(bytes, where);
  reader.require(XXH64(bytes.data(), bytes.size(), 0) == part.checksum, "the checksum of landmarks is wrong");
  const size_t rows = read(reader), at = reader.position();
  (void)reader.take(rows * kDescriptor * sizeof(Pixel));
  reader.finish();
  if (rows == 0) return {};
  return file.image<Pixel>(part.offset + at, cv::Size(kDescriptor, static_cast<int>(rows)));
}

}  // namespace

std::array<double, 11> numbers_of(const Pinhole& c) {
  const Distortion& d = c.distortion;
  return {double(c.width), double(c.height), c.fx, c.fy, c.cx, c.cy, d.k1, d.k2, d.p1, d.p2, d.k3};
}

std::string index_bytes(const MapIndex& index, uint64_t parts_end) {
  Writer writer;
  content(writer, index, Bounds{});
  return with_trailer(std::move(writer.bytes()), parts_end);
}

std::string with_trailer(std::string bytes, uint64_t parts_end) {
  const uint64_t size = bytes.size(), checksum = XXH64(bytes.data(), bytes.size(), parts_end);
  append_bytes(bytes, parts_end);
  append_bytes(bytes, size);
  append_bytes(bytes, checksum);
  return bytes.append(kEnd);
}

IndexOfFile read_index(std::string_view bytes, const std::string& where, int most_files) {
  const auto require = [&](bool holds, const char* what) { Reader({}, where).require(holds, what); };
  require(bytes.size() >= kTrailerBytes && bytes.ends_with(kEnd), "it is truncated");
  Reader trailer(bytes.substr(bytes.size() - kTrailerBytes), where);
  IndexOfFile result;
  uint64_t size = 0, checksum = 0;
  trailer.number(result.parts_end);
  trailer.number(size);
  trailer.number(checksum);
  require(size <= bytes.size() - kTrailerBytes, "it is truncated");
  result.begin = bytes.size() - kTrailerBytes - size;
  const std::string_view plain = bytes.substr(result.begin, size);
  require(XXH64(plain.data(), plain.size(), result.parts_end) == checksum, "the checksum of its index is wrong");
  require(result.parts_end % kMapAlignment == 0, "a part is misplaced");
  Reader reader(plain, where);
  content(reader, result.index, {result.parts_end, most_files});
  reader.finish();
  return result;
}

std::string digest_bytes(const LandmarkDigest& digest) {
  return with_descriptors([&](Writer& writer) { digest_of_view(writer, digest); }, digest.descriptors);
}

LandmarkDigest read_digest(const MappedFile& file, const FilePart& part, const std::string& where) {
  LandmarkDigest digest;
  digest.descriptors = descriptors_of<uchar>(file, part, where, [&](Reader& reader) {
    digest_of_view(reader, digest);
    return digest.indices.size();
  });
  return digest;
}

std::string landmark_bytes(const Landmarks& l) {
  return with_descriptors([&](Writer& writer) { landmarks(writer, l); }, l.keypoints.descriptors);
}

Landmarks read_landmarks(const MappedFile& file, const FilePart& part, const std::string& where) {
  Landmarks result;
  result.keypoints.descriptors = descriptors_of<float>(file, part, where, [&](Reader& reader) {
    landmarks(reader, result);
    return result.keypoints.keypoints.size();
  });
  return result;
}

Landmarks read_landmarks(const MappedFile& file, const FilePart& part, const LandmarkCounts& expected,
                         const std::string& where) {
  Landmarks result = read_landmarks(file, part, where);
  if (result.keypoints.keypoints.size() != expected.keypoints || result.landmarks.size() != expected.landmarks)
    throw Error(where + ": is damaged: the landmarks of a keyframe are not those of its digest; create the map again");
  return result;
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// The index of a saved map: all of it but the images and landmarks, and where these lie. Little-endian.
//
// A map file consists of the line kMapMagic, filled up with zeros to kMapAlignment bytes; the parts, each at a multiple of
// kMapAlignment: images of frames, landmarks of keyframes and their digests; the index; and a trailer that says where the index is. Every
// part and the index have a checksum (XXH64). Parts are never changed once written, so a file that grows stays valid for
// every index that was made of it (map_journal.h).
//
// The images of a frame are those of StoredFrame, uncompressed, each at a multiple of kMapAlignment, so that they are
// used where they lie, without reading the others.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/map/keyframe_map.h"
#include "core/types/pinhole.h"

namespace fringeslam {

constexpr std::string_view kMapMagic = "FringeSLAM map 4\n", kAnyMapMagic = "FringeSLAM map ";
constexpr uint64_t kMapAlignment = 64;

constexpr uint64_t aligned(uint64_t bytes) { return (bytes + kMapAlignment - 1) / kMapAlignment * kMapAlignment; }

// Size of the images of a frame in the file, and the place of each image within them.
struct FrameLayout {
  explicit FrameLayout(cv::Size image) : size(image) {
    const auto pixels = static_cast<uint64_t>(image.area());
    sigma = aligned(pixels * sizeof(float));
    normals = sigma + aligned(pixels * sizeof(short));
    texture = normals + aligned(pixels * sizeof(cv::Vec2s));
    bytes = texture + aligned(pixels);
  }
  cv::Size size;
  uint64_t sigma = 0, normals = 0, texture = 0, bytes = 0;  // depth is at 0
};

// A part, and the file that contains it: 0 for the map's own; a journal's parts may be in a second one.
struct StoredPart : FilePart {
  uint8_t file = 0;
};

struct MapIndex {
  struct KeyframeEntry {
    int index = 0;
    double timestamp_s = 0;
    Pose world_from_camera;
    KeyframeMotion motion;
    StoredPart images, landmarks, digest;
  };
  // A frame with the images of its keyframe is the keyframe itself.
  struct FrameEntry {
    int keyframe = 0;
    Pose keyframe_from_camera;
    int index = 0;
    double timestamp_s = 0;
    StoredPart images;
    bool own = false;
  };
  std::array<double, 11> camera{};  // size, intrinsics, distortion
  std::vector<KeyframeEntry> keyframes;
  std::vector<FrameEntry> frames;
  std::vector<PoseEdge> links;

  cv::Size image_size() const { return {static_cast<int>(camera[0]), static_cast<int>(camera[1])}; }
};

std::array<double, 11> numbers_of(const Pinhole& camera);

// Returns the index and the trailer, as they follow the parts: `parts_end` is a multiple of kMapAlignment.
std::string index_bytes(const MapIndex& index, uint64_t parts_end);

// Returns the content of an index with its trailer.
std::string with_trailer(std::string content, uint64_t parts_end);

// Reads the index at the end of `bytes`, a map file or the index of a journal. Poses are finite, covariances and information
// matrices positive semidefinite, and all indices in range. Parts of file 0 lie before parts_end; other files are permitted only if `most_files` > 1. Throws Error, beginning
// with `where`, if it is truncated or damaged.
struct IndexOfFile {
  MapIndex index;
  uint64_t parts_end = 0, begin = 0;  // where the parts end, and where the index begins in `bytes`
};
IndexOfFile read_index(std::string_view bytes, const std::string& where, int most_files = 1);

// Returns the landmarks of a keyframe as a part: what re-identification needs; how they were detected is not stored.
std::string landmark_bytes(const Landmarks& landmarks);

// Returns their digest as a part, and reads it.
std::string digest_bytes(const LandmarkDigest& digest);
LandmarkDigest read_digest(const MappedFile& file, const FilePart& part, const std::string& where);

// Reads landmarks whose descriptors stay in the file. Throws Error, beginning with `where`, if they are damaged.
Landmarks read_landmarks(const MappedFile& file, const FilePart& part, const std::string& where);
// The numbers of keypoints and landmarks according to a keyframe's digest, whose indices refer to the landmarks.
struct LandmarkCounts {
  size_t keypoints = 0, landmarks = 0;

  explicit LandmarkCounts(const LandmarkDigest& digest)
      : keypoints(static_cast<size_t>(digest.keypoints)), landmarks(digest.strongest.size()) {}
};
// The same; throws Error also unless the landmarks are those of the keyframe's digest.
Landmarks read_landmarks(const MappedFile& file, const FilePart& part, const LandmarkCounts& expected,
                         const std::string& where);

}  // namespace fringeslam

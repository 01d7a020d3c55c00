// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a saved map must give finite numbers or a one-line Error that
// names the file. The first letter says what the other bytes are: f, a file; i, an index; l and d, the landmarks of a keyframe and their digest.
// The last three get right checksums, which hardly any mutation would find.
#include <unistd.h>
#define XXH_INLINE_ALL  // the harness does not link the library
#include <xxhash.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

#include "core/landmarks/recognition.h"
#include "core/storage/map_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

namespace fs = std::filesystem;

void require(bool holds, const std::string& what) {
  if (holds) return;
  std::fprintf(stderr, "map_file_fuzz: %s\n", what.c_str());
  std::abort();
}

fs::path place() {
  static const fs::path file = fs::temp_directory_path() / ("fringeslam-map-" + std::to_string(::getpid()));
  return file;
}

void write(const std::string& bytes) {
  std::ofstream out(place(), std::ios::binary);
  out << bytes;
  out.close();
  require(bool(out), place().string() + " cannot be written");
}

std::string whole_map(const std::string& index) {
  std::string bytes(kMapMagic);
  bytes.resize(1 << 12, '\0');
  return bytes + with_trailer(index, bytes.size());
}

void check_file() {
  const MapIndex index = read_map_info(place()).content.index;
  require(!index.keyframes.empty(), "a map without keyframes");
  for (const auto& keyframe : index.keyframes) require(keyframe.world_from_camera.is_finite(), "a non-finite pose");
  for (const auto& frame : index.frames)
    require(frame.keyframe >= 0 && static_cast<size_t>(frame.keyframe) < index.keyframes.size(), "an invalid keyframe");
  verify_map(place());
}

void check_landmarks() {
  const auto memory = map_into_memory(place());
  const FilePart part{0, memory->bytes().size(), XXH64(memory->bytes().data(), memory->bytes().size(), 0)};
  const Landmarks landmarks = read_landmarks(*memory, part, place().string());
  const size_t count = landmarks.keypoints.keypoints.size();
  require(static_cast<size_t>(landmarks.keypoints.descriptors.rows) == count, "keypoints without a descriptor");
  for (const Keypoint& keypoint : landmarks.keypoints.keypoints)
    require(keypoint.point_m.allFinite(), "a non-finite point");
  for (const Landmark& landmark : landmarks.landmarks) {
    for (const int k : landmark.keypoints) require(k >= 0 && static_cast<size_t>(k) < count, "an invalid keypoint");
  }
}

void check_digest() {
  const auto memory = map_into_memory(place());
  const FilePart part{0, memory->bytes().size(), XXH64(memory->bytes().data(), memory->bytes().size(), 0)};
  const LandmarkDigest digest = read_digest(*memory, part, place().string());
  require(static_cast<size_t>(digest.descriptors.rows) == digest.indices.size(), "keypoints without a descriptor");
  require(static_cast<size_t>(digest.starts.back()) <= digest.owners.size(), "an invalid landmark");
}

void write_seeds(const fs::path& folder) {
  Landmarks landmarks;
  landmarks.keypoints.keypoints.resize(2);
  landmarks.keypoints.descriptors = cv::Mat1f(2, 128, 0.1f);
  landmarks.landmarks = {{{}, {{1, 2}, {3, 4}, {5, 6}}, {0, 1}}};
  std::ofstream(folder / "landmarks", std::ios::binary) << 'l' + landmark_bytes(landmarks);
  std::ofstream(folder / "digest", std::ios::binary) << 'd' + digest_bytes(digest_of(landmarks));
  MapIndex index;
  index.camera = {4, 3};
  const uint64_t bytes = FrameLayout(index.image_size()).bytes;
  StoredPart images, own;
  images.offset = own.offset = kMapAlignment;
  images.size = bytes;
  own.size = 64;
  index.keyframes = {{0, 0, {}, images, own, own}, {1, 1, {}, images, own, own}};
  index.frames = {{0, {}, 0, 0, images, true}, {1, {}, 1, 1, images, true}, {1, {}, 2, 2, images, false}};
  index.links = {{0, 1, {}, Matrix6d::Identity(), false}};
  const std::string with = index_bytes(index, 1 << 12), trailer = with_trailer("", 0);
  std::ofstream(folder / "index", std::ios::binary) << 'i' + with.substr(0, with.size() - trailer.size());
  std::ofstream(folder / "file", std::ios::binary) << 'f' + whole_map(with.substr(0, with.size() - trailer.size()));
}

}  // namespace

}  // namespace fringeslam

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  if (*argc != 3 || std::strcmp((*argv)[1], "--seeds") != 0) return 0;
  fringeslam::write_seeds((*argv)[2]);
  std::exit(0);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam;
  if (size == 0) return -1;
  const std::string bytes(reinterpret_cast<const char*>(data + 1), size - 1);
  write(data[0] == 'i' ? whole_map(bytes) : bytes);
  try {
    data[0] == 'l' ? check_landmarks() : data[0] == 'd' ? check_digest() : check_file();
  } catch (const Error& error) {
    const std::string message = error.what();
    require(message.starts_with(place().string()), "a message that does not begin with the file: " + message);
    require(message.find('\n') == std::string::npos, "a message of several lines: " + message);
  }
  return 0;
}

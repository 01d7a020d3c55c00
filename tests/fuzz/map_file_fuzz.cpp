// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a saved map must give finite numbers or a one-line Error that
// names the file. The first letter says what the other bytes are: f, a file; i, an index; l and d, the landmarks of a keyframe and their digest.
// The last three get right checksums, which hardly any mutation would find.
#define XXH_INLINE_ALL  // the harness does not link the library
#include <xxhash.h>

#include <string>

#include "core/landmarks/recognition.h"
#include "core/storage/map_file.h"
#include "tests/fuzz/fuzzing.h"

namespace fringeslam {

namespace {

namespace fs = std::filesystem;
using fuzz::require;

const fs::path& place() {
  static const fs::path file = fuzz::folder() / "saved.map";
  return file;
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
  fuzz::write(folder / "landmarks", 'l' + landmark_bytes(landmarks));
  fuzz::write(folder / "digest", 'd' + digest_bytes(digest_of(landmarks)));
  MapIndex index;
  index.camera = {4, 3};
  const uint64_t bytes = FrameLayout(index.image_size()).bytes;
  StoredPart images, own;
  images.offset = own.offset = kMapAlignment;
  images.size = bytes;
  own.size = 64;
  index.keyframes = {{0, 0, {}, {}, images, own, own}, {1, 1, {}, {}, images, own, own}};
  index.frames = {{0, {}, 0, 0, images, true}, {1, {}, 1, 1, images, true}, {1, {}, 2, 2, images, false}};
  index.links = {{0, 1, {}, Matrix6d::Identity(), false}};
  const std::string with = index_bytes(index, 1 << 12), trailer = with_trailer("", 0);
  fuzz::write(folder / "index", 'i' + with.substr(0, with.size() - trailer.size()));
  fuzz::write(folder / "file", 'f' + whole_map(with.substr(0, with.size() - trailer.size())));
}

}  // namespace

}  // namespace fringeslam

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  return fringeslam::fuzz::seeds_on_request(*argc, *argv, fringeslam::write_seeds);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam;
  if (size == 0) return -1;
  const std::string bytes = fuzz::text_of(data + 1, size - 1);
  fuzz::write(place(), data[0] == 'i' ? whole_map(bytes) : bytes);
  fuzz::read_or_refuse(place(), [&] {
    data[0] == 'l' ? check_landmarks() : data[0] == 'd' ? check_digest() : check_file();
  });
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
#include "core/storage/map_file.h"

#include <algorithm>
#include <new>
#include <utility>

#include "core/base/parallel.h"
#include "core/io/input_file.h"
#include "core/landmarks/recognition.h"
#include "core/storage/map_parts.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

MapIndex::KeyframeEntry entry_of(const Keyframe& keyframe) {
  return {keyframe.index, keyframe.timestamp_s, keyframe.world_from_camera, keyframe.motion, {}, {}, {}};
}

IndexOfFile index_of(const MappedFile& file, const std::string& where) {
  const std::string_view bytes = file.bytes();
  if (!bytes.starts_with(kAnyMapMagic)) throw Error(where + ": is not a map; use a file written by `run --save-map`");
  if (!bytes.starts_with(kMapMagic)) throw Error(where + ": is a map of another format version; create the map again");
  IndexOfFile result = read_index(bytes, where);
  if (result.begin != result.parts_end)
    throw Error(where + ": is damaged (its index is misplaced); create the map again");
  if (result.index.keyframes.empty()) throw Error(where + ": contains no keyframe; create the map again");
  return result;
}

// Calls body(i) for all i in parallel; throws the error of the lowest i that failed.
template <class Body>
void for_each_or_throw(size_t count, const Body& body) {
  std::vector<std::string> errors(count);
  for_each_row(static_cast<int>(count), [&](int i) {
    try {
      body(static_cast<size_t>(i));
    } catch (const Error& e) {
      errors[static_cast<size_t>(i)] = e.what();
    }
  });
  for (const std::string& error : errors) {
    if (!error.empty()) throw Error(error);
  }
}

}  // namespace

void write_map(const fs::path& file, const KeyframeMap& map) {
  MapIndex index;
  index.camera = numbers_of(map.rig().camera);
  const FrameLayout layout(index.image_size());
  MapParts parts(file);
  for (const Keyframe& keyframe : map.keyframes()) {
    MapIndex::KeyframeEntry& entry = index.keyframes.emplace_back(entry_of(keyframe));
    entry.images = parts.add(keyframe.frame, layout);
    const std::shared_ptr<const Landmarks> landmarks = keyframe.landmarks.get();
    entry.landmarks = parts.add(landmark_bytes(*landmarks));
    entry.digest = parts.add(digest_bytes(digest_of(*landmarks)));
  }
  for (const MapFrame& frame : map.frames()) {
    const auto number = static_cast<size_t>(frame.keyframe);
    const bool own = frame.frame.depth_m.data == map.keyframes()[number].frame.depth_m.data;
    index.frames.push_back({frame.keyframe, frame.keyframe_from_camera, frame.frame.index, frame.frame.timestamp_s,
                            own ? index.keyframes[number].images : parts.add(frame.frame, layout), own});
  }
  index.links = map.links();
  parts.finish(index);
}

std::shared_ptr<const MappedFile> map_into_memory(const fs::path& file) {
  const InputFile input(file, kMostMapBytes);
  try {
    return std::make_shared<const MappedFile>(input.descriptor(), input.size());
  } catch (const std::bad_alloc&) {
    throw Error(file.string() + ": cannot be mapped into memory; copy it to a local disk");
  }
}

StoredFrame frame_in_file(const MappedFile& file, const FilePart& part, const FrameLayout& layout,
                          const std::string& where) {
  return {0,
          0,
          file.image<float>(part.offset, layout.size),
          file.image<short>(part.offset + layout.sigma, layout.size),
          file.image<cv::Vec2s>(part.offset + layout.normals, layout.size),
          file.image<uchar>(part.offset + layout.texture, layout.size),
          std::make_shared<const FrameCheck>(part.checksum, where)};
}

KeyframeMap open_map(const fs::path& file, const RigModel& rig, const MappingOptions& options) {
  const std::string where = file.string();
  const auto memory = map_into_memory(file);
  const MapIndex index = index_of(*memory, where).index;
  if (index.camera != numbers_of(rig.camera))
    throw Error(where + ": was made with another camera than that of rig '" + rig.name + "'; use the rig of the map");
  const FrameLayout layout(index.image_size());
  const auto images = [&](const auto& entry) {
    StoredFrame frame = frame_in_file(*memory, entry.images, layout, where);
    frame.index = entry.index;
    frame.timestamp_s = entry.timestamp_s;
    return frame;
  };
  auto source = std::make_shared<MapSource>();
  source->file = memory;
  // The kernel reads them while the first are parsed.
  for (const MapIndex::KeyframeEntry& entry : index.keyframes) memory->prefetch(entry.digest.offset, entry.digest.size);
  std::vector<Keyframe> keyframes(index.keyframes.size());
  for_each_or_throw(keyframes.size(), [&](size_t i) {
    const MapIndex::KeyframeEntry& entry = index.keyframes[i];
    LandmarkDigest digest = read_digest(*memory, entry.digest, where);
    const auto read = [memory, part = FilePart(entry.landmarks), expected = LandmarkCounts(digest), where] {
      return read_landmarks(*memory, part, expected, where);
    };
    keyframes[i] = {entry.index,   entry.timestamp_s, entry.world_from_camera, KnownLandmarks(std::move(digest), read),
                    images(entry), entry.motion};
  });
  for (const MapIndex::KeyframeEntry& entry : index.keyframes)
    source->keyframes.push_back({entry.landmarks, entry.digest});
  std::vector<MapFrame> frames;
  frames.reserve(index.frames.size());
  for (const MapIndex::FrameEntry& entry : index.frames)
    frames.push_back({entry.keyframe, entry.keyframe_from_camera,
                      entry.own ? keyframes[static_cast<size_t>(entry.keyframe)].frame : images(entry)});
  KeyframeMap map(rig, options);
  map.restore(std::move(keyframes), std::move(frames), index.links, std::move(source));
  return map;
}

MapFileInfo read_map_info(const fs::path& file) {
  const auto memory = map_into_memory(file);
  return {index_of(*memory, file.string()), memory->bytes().size()};
}

void verify_map(const fs::path& file) {
  const std::string where = file.string();
  const auto memory = map_into_memory(file);
  const MapIndex index = index_of(*memory, where).index;
  const FrameLayout layout(index.image_size());
  const auto check = [&](const StoredPart& part) {
    const StoredFrame frame = frame_in_file(*memory, part, layout, where);
    frame.check->check(frame);
    memory->release();
  };
  for_each_or_throw(index.keyframes.size(), [&](size_t i) {
    check(index.keyframes[i].images);
    const LandmarkCounts expected(read_digest(*memory, index.keyframes[i].digest, where));
    (void)read_landmarks(*memory, index.keyframes[i].landmarks, expected, where);
  });
  for_each_or_throw(index.frames.size(), [&](size_t i) {
    if (!index.frames[i].own) check(index.frames[i].images);
  });
}

}  // namespace fringeslam

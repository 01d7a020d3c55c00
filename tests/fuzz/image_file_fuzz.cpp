// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as an image must give an image or a one-line Error that names the
// file. The first letter selects the reader: g and e, a camera image as PNG and as EXR; f, EXR channels; t, ground truth; d, a
// depth estimate; i, a TIFF file. Decodes in this process instead of a sandboxed worker.
#include <opencv2/core.hpp>

#include "core/io/files.h"
#include "core/io/image_library.h"
#include "core/io/image_worker.h"
#include "core/score/truth_files.h"
#include "tests/fuzz/fuzzing.h"

namespace fringeslam::fuzz {

namespace {

namespace fs = std::filesystem;

Pinhole small_camera() {
  Pinhole camera;
  camera.width = 7, camera.height = 5;
  return camera;
}

void check_image(const cv::Mat& image) {
  require(!image.empty() && image.channels() >= 1, "an empty image");
  require(image.cols <= kMostImageSide && image.rows <= kMostImageSide, "an image beyond the limits");
  // All pixels were written.
  (void)cv::sum(image.reshape(1));
}

void check(char reader, const fs::path& file) {
  const Pinhole camera = small_camera();
  switch (reader) {
    case 'f':
      for (const ExrChannel& channel : read_exr(file)) check_image(channel.image);
      return;
    case 't': {
      const TruthFrame truth = read_truth_frame(file, &camera);
      require(truth.depth_m.size() == cv::Size(7, 5) && truth.normals.size() == truth.depth_m.size(), "another size");
      return;
    }
    case 'd':
      check_image(read_depth_estimate(file, &camera).depth_m);
      return;
    default:
      check_image(read_grey(file));
  }
}

// An uncompressed gray TIFF of 4x3 pixels.
std::string tiff_bytes() {
  std::string bytes("II*\0\x08\0\0\0", 8);
  const auto put = [&](unsigned value, int size) {
    for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> (8 * i));
  };
  const std::pair<unsigned, unsigned> entries[] = {{256, 4}, {257, 3}, {258, 8}, {259, 1}, {262, 1},
                                                   {273, 0}, {277, 1}, {278, 3}, {279, 12}};
  const unsigned end = 8 + 2 + 12 * 9 + 4;
  put(9, 2);
  for (const auto& [tag, value] : entries) put(tag, 2), put(4, 2), put(1, 4), put(tag == 273 ? end : value, 4);
  put(0, 4);
  return bytes + "abcdefghijkl";
}

void write_seeds(const fs::path& seeds) {
  cv::Mat1f ramp(5, 7);
  for (int i = 0; i < 35; ++i) ramp(i / 7, i % 7) = 0.7f + 0.01f * static_cast<float>(i);
  cv::Mat1b grey;
  cv::Mat1w deep;
  ramp.convertTo(grey, CV_8U, 100);
  ramp.convertTo(deep, CV_16U, 1000);
  write(seeds / "grey", "g" + png_bytes(grey));
  write(seeds / "deep", "g" + png_bytes(deep));
  write(seeds / "color", "g" + png_bytes(cv::Mat(5, 7, CV_8UC3, cv::Scalar(1, 2, 3))));
  write(seeds / "tiff", "i" + tiff_bytes());
  const std::vector<ExrChannel> truth = {{"depth_m", ramp},  {"normal.x", ramp},  {"normal.y", ramp},
                                         {"normal.z", ramp}, {"object_id", ramp}, {"projector_column", ramp},
                                         {"mask", ramp},     {"sigma_m", ramp}};
  for (const auto& [name, compression] : {std::pair{"zip", ExrCompression::zip}, {"none", ExrCompression::none}}) {
    write(seeds / (std::string("truth_") + name), "t" + exr_bytes(truth, compression));
    write(seeds / (std::string("depth_") + name), "d" + exr_bytes(truth, compression));
    write(seeds / (std::string("one_") + name), "e" + exr_bytes({{"Y", ramp}}, compression));
    write(seeds / (std::string("channels_") + name), "f" + exr_bytes({{"B", ramp}, {"A", ramp}}, compression));
  }
}

}  // namespace

}  // namespace fringeslam::fuzz

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  fringeslam::use_no_image_threads();
  fringeslam::decode_in_this_process(true);
  return fringeslam::fuzz::seeds_on_request(*argc, *argv, fringeslam::fuzz::write_seeds);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam::fuzz;
  const char reader = size > 0 ? static_cast<char>(data[0]) : '\0';
  if (std::string_view("gefitd").find(reader) == std::string_view::npos) return -1;
  const fs::path file = folder() / (reader == 'g' ? "image.png" : reader == 'i' ? "image.tif" : "image.exr");
  write(file, text_of(data + 1, size - 1));
  read_or_refuse(file, [&] { check(reader, file); });
  return 0;
}

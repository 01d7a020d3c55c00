// SPDX-License-Identifier: Apache-2.0
#include "core/io/exr_file.h"

#include <OpenEXR/openexr.h>
#include <libdeflate.h>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "core/types/error.h"

namespace fringeslam {

namespace {

struct ExrSource {
  const std::string& bytes;
  std::string message;  // the first one of the library
};

int64_t exr_size(exr_const_context_t, void* source) {
  return static_cast<int64_t>(static_cast<ExrSource*>(source)->bytes.size());
}

int64_t read_exr_at(exr_const_context_t, void* source, void* target, uint64_t size, uint64_t offset,
                    exr_stream_error_func_ptr_t) {
  const std::string& bytes = static_cast<ExrSource*>(source)->bytes;
  if (offset >= bytes.size()) return 0;
  const size_t count = std::min<uint64_t>(size, bytes.size() - offset);
  std::memcpy(target, bytes.data() + offset, count);
  return static_cast<int64_t>(count);
}

void keep_exr_message(exr_const_context_t context, exr_result_t, const char* message) {
  void* data = nullptr;
  if (exr_get_user_data(context, &data) != EXR_ERR_SUCCESS || data == nullptr || message == nullptr) return;
  auto& source = *static_cast<ExrSource*>(data);
  if (source.message.empty()) source.message = message;
}

// An EXR file in memory.
class ExrFile {
 public:
  explicit ExrFile(const std::string& bytes) : source_{bytes, {}} {
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.user_data = &source_;
    setup.size_fn = exr_size;
    setup.read_fn = read_exr_at;
    setup.error_handler_fn = keep_exr_message;
    opened_ = exr_start_read(&context_, "it", &setup) == EXR_ERR_SUCCESS;
  }
  ~ExrFile() {
    if (context_) exr_finish(&context_);
  }
  ExrFile(const ExrFile&) = delete;
  ExrFile& operator=(const ExrFile&) = delete;

  bool opened() const { return opened_; }
  exr_context_t context() const { return context_; }
  const std::string& message() const { return source_.message; }

 private:
  ExrSource source_;
  exr_context_t context_ = nullptr;
  bool opened_ = false;
};

// Undoes the prediction of each byte by the one before it: replaces differences, offset by 128, by their sums.
void sum_differences(std::vector<uint8_t>& bytes) {
  constexpr uint8_t kOffset = 128;
  bytes[0] = static_cast<uint8_t>(bytes[0] + kOffset);  // has none
  uint8_t sum = 0;
  size_t i = 0;
#if defined(__SSE2__)
  const __m128i offset = _mm_set1_epi8(static_cast<char>(kOffset));
  for (; i + 16 <= bytes.size(); i += 16) {
    auto* place = reinterpret_cast<__m128i*>(bytes.data() + i);
    __m128i sums = _mm_sub_epi8(_mm_loadu_si128(place), offset);
    sums = _mm_add_epi8(sums, _mm_slli_si128(sums, 1));
    sums = _mm_add_epi8(sums, _mm_slli_si128(sums, 2));
    sums = _mm_add_epi8(sums, _mm_slli_si128(sums, 4));
    sums = _mm_add_epi8(sums, _mm_slli_si128(sums, 8));
    sums = _mm_add_epi8(sums, _mm_set1_epi8(static_cast<char>(sum)));
    _mm_storeu_si128(place, sums);
    sum = bytes[i + 15];
  }
#endif
  for (; i < bytes.size(); ++i) bytes[i] = sum = static_cast<uint8_t>(sum + bytes[i] - kOffset);
}

// Undoes the separation of even from odd bytes.
void interleave_bytes(const std::vector<uint8_t>& separated, uint8_t* bytes) {
  const size_t half = separated.size() / 2;
  const uint8_t *even = separated.data(), *odd = even + (separated.size() - half);
  size_t i = 0;
#if defined(__SSE2__)
  for (; i + 16 <= half; i += 16) {
    const __m128i first = _mm_loadu_si128(reinterpret_cast<const __m128i*>(even + i)),
                  second = _mm_loadu_si128(reinterpret_cast<const __m128i*>(odd + i));
    auto* place = reinterpret_cast<__m128i*>(bytes + 2 * i);
    _mm_storeu_si128(place, _mm_unpacklo_epi8(first, second));
    _mm_storeu_si128(place + 1, _mm_unpackhi_epi8(first, second));
  }
#endif
  for (; i < half; ++i) bytes[2 * i] = even[i], bytes[2 * i + 1] = odd[i];
  if (separated.size() % 2 != 0) bytes[2 * half] = even[half];
}

// Replaces the library's decompression of ZIPS chunks.
exr_result_t inflate_chunk(exr_decode_pipeline_t* pipeline) {
  const exr_chunk_info_t& chunk = pipeline->chunk;
  if (pipeline->unpacked_buffer == pipeline->packed_buffer || chunk.unpacked_size == 0) return EXR_ERR_SUCCESS;
  if (chunk.packed_size == chunk.unpacked_size) {  // stored
    std::memcpy(pipeline->unpacked_buffer, pipeline->packed_buffer, chunk.unpacked_size);
    return EXR_ERR_SUCCESS;
  }
  static thread_local const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)>
      decompressor(libdeflate_alloc_decompressor(), libdeflate_free_decompressor);
  static thread_local std::vector<uint8_t> filtered;
  if (!decompressor) return EXR_ERR_OUT_OF_MEMORY;
  filtered.resize(chunk.unpacked_size);
  // Fails unless exactly this number of bytes results.
  if (libdeflate_zlib_decompress(decompressor.get(), pipeline->packed_buffer, chunk.packed_size, filtered.data(),
                                 filtered.size(), nullptr) != LIBDEFLATE_SUCCESS)
    return EXR_ERR_CORRUPT_CHUNK;
  sum_differences(filtered);
  interleave_bytes(filtered, static_cast<uint8_t*>(pipeline->unpacked_buffer));
  return EXR_ERR_SUCCESS;
}

// A file that this decoder reads.
struct ExrLayout {
  exr_attr_box2i_t window{};
  const exr_attr_chlist_t* channels = nullptr;
  exr_compression_t compression = EXR_COMPRESSION_NONE;
  int32_t lines_per_chunk = 1;
  std::vector<int> places;  // of the file's channels in the image

  std::string name_of(int channel) const {
    const exr_attr_string_t& text = channels->entries[channel].name;
    return {text.str, static_cast<size_t>(text.length)};
  }
};

// Returns the places of channels as OpenImageIO arranges them: those of layers ("normal.x") after the others.
std::vector<int> exr_places(const ExrLayout& layout) {
  std::vector<int> order(static_cast<size_t>(layout.channels->num_channels)), places(order.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_partition(order.begin(), order.end(),
                        [&](int channel) { return layout.name_of(channel).find('.') == std::string::npos; });
  for (size_t i = 0; i < order.size(); ++i) places[static_cast<size_t>(order[i])] = static_cast<int>(i);
  return places;
}

std::optional<ExrLayout> exr_layout(exr_context_t context) {
  const auto ok = [](exr_result_t result) { return result == EXR_ERR_SUCCESS; };
  ExrLayout layout;
  int parts = 0;
  exr_storage_t storage{};
  if (!ok(exr_get_count(context, &parts)) || parts != 1 || !ok(exr_get_storage(context, 0, &storage)) ||
      storage != EXR_STORAGE_SCANLINE || !ok(exr_get_data_window(context, 0, &layout.window)) ||
      !ok(exr_get_channels(context, 0, &layout.channels)) ||
      !ok(exr_get_compression(context, 0, &layout.compression)) ||
      !ok(exr_get_scanlines_per_chunk(context, 0, &layout.lines_per_chunk)))
    return std::nullopt;
  const bool known = layout.compression == EXR_COMPRESSION_NONE || layout.compression == EXR_COMPRESSION_ZIPS;
  const exr_attr_chlist_t& list = *layout.channels;
  if (!known || list.num_channels < 1 || list.num_channels > CV_CN_MAX || layout.lines_per_chunk < 1)
    return std::nullopt;
  for (int i = 0; i < list.num_channels; ++i) {
    const exr_attr_chlist_entry_t& channel = list.entries[i];
    if (channel.pixel_type != EXR_PIXEL_FLOAT || channel.x_sampling != 1 || channel.y_sampling != 1)
      return std::nullopt;
  }
  layout.places = exr_places(layout);
  return layout;
}

class ChunkDecoder {
 public:
  ChunkDecoder(exr_context_t context, const ExrLayout& layout) : context_(context), layout_(layout) {}
  ~ChunkDecoder() {
    if (started_) exr_decoding_destroy(context_, &pipeline_);
  }
  ChunkDecoder(const ChunkDecoder&) = delete;
  ChunkDecoder& operator=(const ChunkDecoder&) = delete;

  // Decodes the chunk that starts with a row of the image; false if it is damaged.
  bool decode(int row, cv::Mat& image) {
    exr_chunk_info_t chunk;
    if (exr_read_scanline_chunk_info(context_, 0, layout_.window.min.y + row, &chunk) != EXR_ERR_SUCCESS) return false;
    const bool first = !std::exchange(started_, true);
    if ((first ? exr_decoding_initialize(context_, 0, &chunk, &pipeline_)
               : exr_decoding_update(context_, 0, &chunk, &pipeline_)) != EXR_ERR_SUCCESS)
      return false;
    for (int c = 0; c < pipeline_.channel_count; ++c) {
      exr_coding_channel_info_t& channel = pipeline_.channels[c];
      const auto place = static_cast<size_t>(layout_.places[static_cast<size_t>(c)]);
      channel.decode_to_ptr = image.ptr(row) + sizeof(float) * place;
      channel.user_pixel_stride = static_cast<int32_t>(image.elemSize());
      channel.user_line_stride = static_cast<int32_t>(image.step);
      channel.user_bytes_per_element = sizeof(float);
      channel.user_data_type = EXR_PIXEL_FLOAT;
    }
    if (first) {
      if (exr_decoding_choose_default_routines(context_, 0, &pipeline_) != EXR_ERR_SUCCESS) return false;
      if (layout_.compression == EXR_COMPRESSION_ZIPS) pipeline_.decompress_fn = inflate_chunk;
    }
    return exr_decoding_run(context_, 0, &pipeline_) == EXR_ERR_SUCCESS;
  }

 private:
  exr_context_t context_;
  const ExrLayout& layout_;
  exr_decode_pipeline_t pipeline_ = EXR_DECODE_PIPELINE_INITIALIZER;
  bool started_ = false;
};

}  // namespace

std::optional<cv::Mat> decode_exr(const std::string& bytes, const std::string& name, const AllocateImage& allocate,
                                  int most_channels) {
  const ExrFile file(bytes);
  if (!file.opened()) return std::nullopt;
  const std::optional<ExrLayout> layout = exr_layout(file.context());
  if (!layout || layout->channels->num_channels > most_channels) return std::nullopt;
  const auto width = int64_t{layout->window.max.x} - layout->window.min.x + 1,
             height = int64_t{layout->window.max.y} - layout->window.min.y + 1;
  constexpr int64_t kMost = std::numeric_limits<int>::max();
  const int channels = layout->channels->num_channels;
  if (width < 1 || height < 1 || width > kMost || height > kMost) return std::nullopt;
  ImageHeader header{{static_cast<int>(width), static_cast<int>(height)}, CV_32FC(channels), {}};
  header.channels.resize(layout->places.size());
  for (int i = 0; i < channels; ++i)
    header.channels[static_cast<size_t>(layout->places[static_cast<size_t>(i)])] = layout->name_of(i);
  cv::Mat image = allocate(header);
  ChunkDecoder pipeline(file.context(), *layout);
  for (int row = 0; row < image.rows; row += layout->lines_per_chunk) {
    if (!pipeline.decode(row, image))
      throw Error(name + ": is truncated or damaged: " +
                  (file.message().empty() ? "a chunk cannot be decompressed" : file.message()));
  }
  return image;
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/io/exr_encoder.h"

#include <OpenEXR/openexr.h>
#include <libdeflate.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>
#include <utility>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// The library goes back to write the table of chunks.
int64_t write_exr_at(exr_const_context_t, void* target, const void* source, uint64_t size, uint64_t offset,
                     exr_stream_error_func_ptr_t) {
  std::string& bytes = *static_cast<std::string*>(target);
  try {
    if (bytes.size() < offset + size) bytes.resize(offset + size);
  } catch (const std::bad_alloc&) {
    return -1;  // the library is written in C
  }
  std::memcpy(bytes.data() + offset, source, size);
  return static_cast<int64_t>(size);
}

// Otherwise the library prints messages.
void ignore_message(exr_const_context_t, exr_result_t, const char*) {}

// Arranges a chunk as the format demands: even bytes precede odd ones, and each byte is predicted by the one before it.
void filter(const uint8_t* bytes, size_t size, uint8_t* filtered) {
  constexpr int kOffset = 128;
  const size_t even = (size + 1) / 2, odd = size / 2;
  const auto difference = [&](size_t at, size_t before) {
    return static_cast<uint8_t>(bytes[at] - bytes[before] + kOffset);
  };
  filtered[0] = bytes[0];
  for (size_t i = 1; i < even; ++i) filtered[i] = difference(2 * i, 2 * i - 2);
  if (odd == 0) return;
  filtered[even] = difference(1, 2 * even - 2);
  for (size_t i = 1; i < odd; ++i) filtered[even + i] = difference(2 * i + 1, 2 * i - 1);
}

// Replaces the library's compression of ZIPS chunks by one that is twice as fast.
exr_result_t deflate_chunk(exr_encode_pipeline_t* pipeline) {
  constexpr int kLevel = 4;  // the library's
  static thread_local const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(kLevel), libdeflate_free_compressor);
  static thread_local std::vector<uint8_t> filtered, compressed;
  if (!compressor) return EXR_ERR_OUT_OF_MEMORY;
  const size_t size = pipeline->packed_bytes;
  filtered.resize(size);
  compressed.resize(size);
  filter(static_cast<const uint8_t*>(pipeline->packed_buffer), size, filtered.data());
  const size_t bytes = libdeflate_zlib_compress(compressor.get(), filtered.data(), size, compressed.data(), size - 1);
  // A chunk that does not become smaller is stored as it is.
  pipeline->compressed_buffer = bytes > 0 ? compressed.data() : pipeline->packed_buffer;
  pipeline->compressed_bytes = bytes > 0 ? bytes : size;
  return EXR_ERR_SUCCESS;
}

class ExrEncoder {
 public:
  ExrEncoder() = default;
  ~ExrEncoder() {
    end_rows();
    if (context_) exr_finish(&context_);
  }
  ExrEncoder(const ExrEncoder&) = delete;
  ExrEncoder& operator=(const ExrEncoder&) = delete;

  std::string encoded(const std::vector<ExrChannel>& channels, ExrCompression compression) {
    if (channels.empty()) throw Error("EXR image: has no channel");
    const cv::Size size = channels[0].image.size();
    write_header(channels, size, compression);
    for (int row = 0; row < size.height; ++row) write_row(channels, row, compression);
    end_rows();
    check(exr_finish(&context_));
    return std::move(bytes_);
  }

 private:
  static void check(exr_result_t result) {
    if (result != EXR_ERR_SUCCESS)
      throw Error(std::string("EXR image: cannot be encoded: ") + exr_get_default_error_message(result));
  }

  void write_header(const std::vector<ExrChannel>& channels, cv::Size size, ExrCompression compression) {
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.user_data = &bytes_;
    setup.write_fn = write_exr_at;
    setup.error_handler_fn = ignore_message;
    check(exr_start_write(&context_, "memory.exr", EXR_WRITE_FILE_DIRECTLY, &setup));
    constexpr size_t kLongestName = 31;  // of files that every reader accepts
    for (const ExrChannel& channel : channels) {
      if (channel.name.size() > kLongestName) check(exr_set_longname_support(context_, 1));
    }
    int part = 0;
    check(exr_add_part(context_, "", EXR_STORAGE_SCANLINE, &part));
    check(exr_initialize_required_attr_simple(
        context_, part, size.width, size.height,
        compression == ExrCompression::zip ? EXR_COMPRESSION_ZIPS : EXR_COMPRESSION_NONE));
    for (const ExrChannel& channel : channels) {
      if (channel.image.type() != CV_32FC1 || channel.image.size() != size)
        throw Error("EXR image: channel " + channel.name + " has another type or size than the image");
      check(exr_add_channel(context_, part, channel.name.c_str(), EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1));
    }
    check(exr_write_header(context_));
  }

  // Writes a row of the image, which is a chunk of its own with each of our compressions.
  void write_row(const std::vector<ExrChannel>& channels, int row, ExrCompression compression) {
    exr_chunk_info_t chunk;
    check(exr_write_scanline_chunk_info(context_, 0, row, &chunk));
    const bool first = !started_;
    check(first ? exr_encoding_initialize(context_, 0, &chunk, &pipeline_)
                : exr_encoding_update(context_, 0, &chunk, &pipeline_));
    started_ = true;
    for (int c = 0; c < pipeline_.channel_count; ++c) {
      exr_coding_channel_info_t& place = pipeline_.channels[c];  // sorted by name
      const auto channel = std::find_if(channels.begin(), channels.end(),
                                        [&](const ExrChannel& given) { return given.name == place.channel_name; });
      place.encode_from_ptr = channel->image.ptr(row);
      place.user_pixel_stride = sizeof(float);
      place.user_line_stride = static_cast<int32_t>(channel->image.step);
      place.user_bytes_per_element = sizeof(float);
      place.user_data_type = EXR_PIXEL_FLOAT;
    }
    if (first) {
      check(exr_encoding_choose_default_routines(context_, 0, &pipeline_));
      own_buffer_ = compression == ExrCompression::zip;
      if (own_buffer_) pipeline_.compress_fn = deflate_chunk;
    }
    check(exr_encoding_run(context_, 0, &pipeline_));
  }

  // Must precede exr_finish(): without a context, the library does not free its buffers.
  void end_rows() {
    if (!std::exchange(started_, false)) return;
    if (own_buffer_) pipeline_.compressed_buffer = nullptr;  // it is not the library's
    exr_encoding_destroy(context_, &pipeline_);
  }

  std::string bytes_;
  exr_context_t context_ = nullptr;
  exr_encode_pipeline_t pipeline_ = EXR_ENCODE_PIPELINE_INITIALIZER;
  bool started_ = false, own_buffer_ = false;
};

}  // namespace

std::string exr_bytes(const std::vector<ExrChannel>& channels, ExrCompression compression) {
  return ExrEncoder().encoded(channels, compression);
}

}  // namespace fringeslam

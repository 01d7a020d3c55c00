// SPDX-License-Identifier: Apache-2.0
#include "core/io/png_file.h"

#include <libdeflate.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstring>
#include <memory>
#include <new>
#include <utility>
#include <vector>

#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr std::array<unsigned char, 8> kPngSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
constexpr png_uint_32 kMostPngSide = 16384;
constexpr png_alloc_size_t kMostPngChunk = 16 << 20;  // bytes of a text or profile after inflation

// libpng reports errors by longjmp. The functions that set a jump target therefore have no objects with destructors.
class PngErrors {
 public:
  const char* message() const { return message_.data(); }

 protected:
  PngErrors() = default;
  ~PngErrors() = default;
  png_voidp errors() { return this; }  // what libpng passes to on_error()
  bool fail(const char* message) {
    std::strncpy(message_.data(), message, message_.size() - 1);
    return false;
  }
  [[noreturn]] static void on_error(png_structp png, png_const_charp message) {
    static_cast<PngErrors*>(png_get_error_ptr(png))->fail(message);
    png_longjmp(png, 1);
  }
  static void on_warning(png_structp, png_const_charp) {}

 private:
  std::array<char, 128> message_{};
};

class PngDecoder : public PngErrors {
 public:
  explicit PngDecoder(const std::string& bytes) : bytes_(bytes) {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, errors(), &on_error, &on_warning);
    info_ = png_ ? png_create_info_struct(png_) : nullptr;
  }
  ~PngDecoder() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngDecoder(const PngDecoder&) = delete;
  PngDecoder& operator=(const PngDecoder&) = delete;

  bool read_header() {
    if (!info_) return fail("memory does not suffice");
    if (setjmp(png_jmpbuf(png_))) return false;
    png_set_user_limits(png_, kMostPngSide, kMostPngSide);
    png_set_chunk_malloc_max(png_, kMostPngChunk);
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_NEVER, nullptr, 0);
    png_set_read_fn(png_, this, &on_read);
    png_read_info(png_, info_);
    const int colour = png_get_color_type(png_, info_);
    if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if (colour == PNG_COLOR_TYPE_GRAY && png_get_bit_depth(png_, info_) < 8) png_set_expand_gray_1_2_4_to_8(png_);
    if (png_get_valid(png_, info_, PNG_INFO_tRNS)) png_set_tRNS_to_alpha(png_);
    if (png_get_bit_depth(png_, info_) == 16) png_set_swap(png_);  // the file is big-endian
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return true;
  }
  bool read_rows(png_bytep* rows) {
    if (setjmp(png_jmpbuf(png_))) return false;
    png_read_image(png_, rows);
    png_read_end(png_, nullptr);
    return true;
  }
  int width() const { return static_cast<int>(png_get_image_width(png_, info_)); }
  int height() const { return static_cast<int>(png_get_image_height(png_, info_)); }
  size_t row_bytes() const { return png_get_rowbytes(png_, info_); }
  int type() const {
    return CV_MAKETYPE(png_get_bit_depth(png_, info_) == 16 ? CV_16U : CV_8U, png_get_channels(png_, info_));
  }

 private:
  static void on_read(png_structp png, png_bytep to, size_t size) {
    auto* decoder = static_cast<PngDecoder*>(png_get_io_ptr(png));
    if (size > decoder->bytes_.size() - decoder->at_) png_error(png, "the file is truncated");
    std::memcpy(to, decoder->bytes_.data() + decoder->at_, size);
    decoder->at_ += size;
  }

  const std::string& bytes_;
  size_t at_ = 0;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

class PngEncoder : public PngErrors {
 public:
  PngEncoder() {
    png_ = png_create_write_struct(PNG_LIBPNG_VER_STRING, errors(), &on_error, &on_warning);
    info_ = png_ ? png_create_info_struct(png_) : nullptr;
  }
  ~PngEncoder() { png_destroy_write_struct(&png_, &info_); }
  PngEncoder(const PngEncoder&) = delete;
  PngEncoder& operator=(const PngEncoder&) = delete;

  bool encode(const cv::Mat& image, const PngEncoding& encoding, png_bytep* rows) {
    if (!info_) return fail("memory does not suffice");
    if (setjmp(png_jmpbuf(png_))) return false;
    write_header(image);
    png_set_compression_level(png_, encoding.level);
    if (image.depth() == CV_16U) png_set_swap(png_);  // the file is big-endian
    png_write_image(png_, rows);
    png_write_end(png_, nullptr);
    return true;
  }
  // Writes pixels that are already filtered and compressed.
  bool write_compressed(const cv::Mat& image, const std::vector<uint8_t>& pixels) {
    if (!info_) return fail("memory does not suffice");
    if (setjmp(png_jmpbuf(png_))) return false;
    write_header(image);
    for (size_t at = 0; at < pixels.size(); at += kLongestChunk)
      png_write_chunk(png_, png_const_bytep("IDAT"), pixels.data() + at, std::min(kLongestChunk, pixels.size() - at));
    png_write_chunk(png_, png_const_bytep("IEND"), nullptr, 0);
    return true;
  }
  std::string& bytes() { return bytes_; }

 private:
  static constexpr size_t kLongestChunk = size_t{1} << 30;

  void write_header(const cv::Mat& image) {
    constexpr std::array kColours = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                     PNG_COLOR_TYPE_RGB_ALPHA};
    png_set_write_fn(png_, this, &on_write, &on_flush);
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(image.cols), static_cast<png_uint_32>(image.rows),
                 image.depth() == CV_16U ? 16 : 8, kColours.at(static_cast<size_t>(image.channels()) - 1),
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png_, info_);
  }

  static void on_write(png_structp png, png_bytep from, size_t size) {
    if (!static_cast<PngEncoder*>(png_get_io_ptr(png))->append(from, size)) png_error(png, "memory does not suffice");
  }
  bool append(png_bytep from, size_t size) {
    try {
      bytes_.append(reinterpret_cast<const char*>(from), size);
    } catch (const std::bad_alloc&) {
      return false;  // libpng is written in C
    }
    return true;
  }
  static void on_flush(png_structp) {}

  std::string bytes_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

// Appends a row of the file: its filter, and its pixels with the highest byte first, minus those of the row above.
void append_row(const cv::Mat& image, int row, PngFilter filter, std::vector<uint8_t>& filtered) {
  constexpr uint8_t kNone = 0, kUp = 2;  // PNG specification, 9.2
  const size_t bytes = static_cast<size_t>(image.cols) * image.elemSize();
  filtered.push_back(filter == PngFilter::up ? kUp : kNone);
  const size_t at = filtered.size();
  filtered.resize(at + bytes);
  uint8_t* to = filtered.data() + at;
  const uint8_t* here = image.ptr(row);
  const uint8_t* above = filter == PngFilter::up && row > 0 ? image.ptr(row - 1) : nullptr;
  const auto value = [&](size_t i) { return static_cast<uint8_t>(here[i] - (above ? above[i] : 0)); };
  if (image.depth() == CV_8U) {
    for (size_t i = 0; i < bytes; ++i) to[i] = value(i);
    return;
  }
  for (size_t i = 0; i < bytes; i += 2) {
    to[i] = value(i + 1);
    to[i + 1] = value(i);
  }
}

std::vector<uint8_t> compressed(const cv::Mat& image, const PngEncoding& encoding) {
  std::vector<uint8_t> filtered;
  filtered.reserve(static_cast<size_t>(image.rows) * (static_cast<size_t>(image.cols) * image.elemSize() + 1));
  for (int row = 0; row < image.rows; ++row) append_row(image, row, encoding.filter, filtered);
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(encoding.level), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::vector<uint8_t> pixels(libdeflate_zlib_compress_bound(compressor.get(), filtered.size()));
  pixels.resize(
      libdeflate_zlib_compress(compressor.get(), filtered.data(), filtered.size(), pixels.data(), pixels.size()));
  return pixels;
}

}  // namespace

bool is_png(std::string_view bytes) {
  return bytes.size() >= kPngSignature.size() &&
         std::memcmp(bytes.data(), kPngSignature.data(), kPngSignature.size()) == 0;
}

cv::Mat decode_png(const std::string& bytes, const std::string& name, const AllocateImage& allocate) {
  const auto damaged = [&](const char* what) {
    return Error(name + ": is truncated or damaged (" + what + "); record or render it again");
  };
  PngDecoder decoder(bytes);
  if (!decoder.read_header()) throw damaged(decoder.message());
  ImageHeader header{{decoder.width(), decoder.height()}, decoder.type(), {"Y", "A"}};
  const int channels = CV_MAT_CN(header.type);
  if (channels > 2) header.channels = {"R", "G", "B", "A"};
  header.channels.resize(static_cast<size_t>(channels));
  if (static_cast<size_t>(CV_ELEM_SIZE(header.type)) * static_cast<size_t>(header.size.width) != decoder.row_bytes())
    throw damaged("unknown pixel format");
  cv::Mat image = allocate(header);
  std::vector<png_bytep> rows;
  for (int row = 0; row < image.rows; ++row) rows.push_back(image.ptr(row));
  if (!decoder.read_rows(rows.data())) throw damaged(decoder.message());
  return image;
}

std::string encode_png(const cv::Mat& image, const PngEncoding& encoding) {
  if ((image.depth() != CV_8U && image.depth() != CV_16U) || image.channels() > 4)
    throw Error("PNG image: pixels have " + std::to_string(image.channels()) +
                " channels of a type that PNG does not have; it has one to four of 8 or 16 bits");
  PngEncoder encoder;
  bool written = false;
  if (encoding.filter == PngFilter::best_of_row) {
    std::vector<png_bytep> rows;
    for (int row = 0; row < image.rows; ++row) rows.push_back(const_cast<png_bytep>(image.ptr(row)));
    written = encoder.encode(image, encoding, rows.data());
  } else {
    written = encoder.write_compressed(image, compressed(image, encoding));
  }
  if (!written) throw Error(std::string("PNG image: cannot be encoded: ") + encoder.message());
  return std::move(encoder.bytes());
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/io/jpeg_file.h"

#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
// clang-format off: after <cstdio>, which it needs and does not include
#include <jpeglib.h>
// clang-format on

#include "core/types/error.h"

namespace fringeslam {

namespace {

// libjpeg reports errors by a function that must not return.
struct JpegErrors {
  jpeg_error_mgr manager;  // first: libjpeg knows the address of this part
  std::jmp_buf jump;
  std::array<char, JMSG_LENGTH_MAX> message{};
};

[[noreturn]] void on_jpeg_error(j_common_ptr jpeg) {
  auto* errors = reinterpret_cast<JpegErrors*>(jpeg->err);
  errors->manager.format_message(jpeg, errors->message.data());
  std::longjmp(errors->jump, 1);
}

struct JpegBuffer {
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  JpegBuffer() = default;
  JpegBuffer(const JpegBuffer&) = delete;
  JpegBuffer& operator=(const JpegBuffer&) = delete;
  ~JpegBuffer() { std::free(bytes); }
};

// Has no objects with destructors, because libjpeg leaves it by longjmp.
bool encode(const cv::Mat1b& image, int quality, JpegBuffer& buffer, JpegErrors& errors) {
  jpeg_compress_struct jpeg;
  jpeg.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = on_jpeg_error;
  jpeg_create_compress(&jpeg);
  if (setjmp(errors.jump)) {
    jpeg_destroy_compress(&jpeg);
    return false;
  }
  jpeg_mem_dest(&jpeg, &buffer.bytes, &buffer.size);
  jpeg.image_width = static_cast<JDIMENSION>(image.cols);
  jpeg.image_height = static_cast<JDIMENSION>(image.rows);
  jpeg.input_components = 1;
  jpeg.in_color_space = JCS_GRAYSCALE;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    JSAMPROW row = const_cast<JSAMPROW>(image.ptr(static_cast<int>(jpeg.next_scanline)));
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  return true;
}

}  // namespace

std::string jpeg_bytes(const cv::Mat1b& image, int quality) {
  JpegBuffer buffer;
  JpegErrors errors;
  if (!encode(image, quality, buffer, errors))
    throw Error(std::string("JPEG image: cannot be encoded: ") + errors.message.data());
  return {reinterpret_cast<const char*>(buffer.bytes), buffer.size};
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/io/jpeg_file.h"

#include <array>
#include <csetjmp>
#include <cstdio>
#include <new>
#include <utility>
// clang-format off: after <cstdio>, which they need and do not include
#include <jerror.h>
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

// Receives the encoded bytes.
struct JpegTarget {
  jpeg_destination_mgr manager;  // first, like that of JpegErrors
  std::array<JOCTET, 1 << 14> part;
  std::string bytes;

  void reset_part() { manager.next_output_byte = part.data(), manager.free_in_buffer = part.size(); }
  bool append(size_t count) {
    try {
      bytes.append(reinterpret_cast<const char*>(part.data()), count);
    } catch (const std::bad_alloc&) {
      return false;  // libjpeg is written in C
    }
    return true;
  }
};

void append_or_fail(j_compress_ptr jpeg, size_t count) {
  if (!reinterpret_cast<JpegTarget*>(jpeg->dest)->append(count)) ERREXIT1(jpeg, JERR_OUT_OF_MEMORY, 0);
}

void start_target(j_compress_ptr jpeg) { reinterpret_cast<JpegTarget*>(jpeg->dest)->reset_part(); }
boolean next_part(j_compress_ptr jpeg) {
  auto* target = reinterpret_cast<JpegTarget*>(jpeg->dest);
  append_or_fail(jpeg, target->part.size());
  target->reset_part();
  return TRUE;
}
void end_target(j_compress_ptr jpeg) {
  auto* target = reinterpret_cast<JpegTarget*>(jpeg->dest);
  append_or_fail(jpeg, target->part.size() - target->manager.free_in_buffer);
}

// Has no objects with destructors, because libjpeg leaves it by longjmp.
bool encode(const cv::Mat1b& image, int quality, JpegTarget& target, JpegErrors& errors) {
  jpeg_compress_struct jpeg{};
  jpeg.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = on_jpeg_error;
  if (setjmp(errors.jump)) {
    jpeg_destroy_compress(&jpeg);
    return false;
  }
  jpeg_create_compress(&jpeg);
  target.manager.init_destination = start_target;
  target.manager.empty_output_buffer = next_part;
  target.manager.term_destination = end_target;
  jpeg.dest = &target.manager;
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
  JpegTarget target;
  JpegErrors errors;
  if (!encode(image, quality, target, errors))
    throw Error(std::string("JPEG image: cannot be encoded: ") + errors.message.data());
  return std::move(target.bytes);
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/tar.h"

#include <cstdint>
#include <cstdio>

#include "core/types/error.h"

namespace fringeslam::datasets {

namespace {

// Fields of the header: offset and width in bytes (IEEE Std 1003.1-1988, "ustar").
struct Field {
  size_t at, width;
};
constexpr Field kName{0, 100}, kMode{100, 8}, kOwner{108, 8}, kGroup{116, 8}, kSize{124, 12}, kTime{136, 12},
    kChecksum{148, 8}, kType{156, 1}, kMagic{257, 8};
constexpr uint64_t kSizeLimit = uint64_t{1} << 33;  // eleven octal digits
// 2000-01-01: GNU tar warns about files from 1970.
constexpr uint64_t kFixedTime_s = 946684800;

void put(std::string& header, Field field, std::string_view text) { header.replace(field.at, text.size(), text); }

// Octal digits with leading zeros; the last byte remains zero.
void put_octal(std::string& header, Field field, uint64_t value) {
  char digits[16];
  std::snprintf(digits, sizeof digits, "%0*llo", static_cast<int>(field.width - 1),
                static_cast<unsigned long long>(value));
  put(header, field, digits);
}

std::string header_of(const std::string& name, uint64_t bytes) {
  if (name.size() > kName.width) throw Error(name + ": is longer than the 100 bytes that a tar archive permits");
  if (bytes >= kSizeLimit) throw Error(name + ": has 8 GiB or more, which a tar archive does not permit");
  std::string header(kTarBlock, '\0');
  put(header, kName, name);
  put_octal(header, kMode, 0644);
  put_octal(header, kOwner, 0);
  put_octal(header, kGroup, 0);
  put_octal(header, kSize, bytes);
  put_octal(header, kTime, kFixedTime_s);
  put(header, kChecksum, "        ");  // counts as blanks in its own sum
  put(header, kType, "0");             // a regular file
  put(header, kMagic,
      std::string_view("ustar\0"
                       "00",
                       kMagic.width));
  unsigned sum = 0;
  for (const char byte : header) sum += static_cast<unsigned char>(byte);
  char digits[8];
  std::snprintf(digits, sizeof digits, "%06o", sum);  // then a zero and a blank
  put(header, kChecksum, std::string_view(digits, 7));
  return header;
}

}  // namespace

std::string tar_member(const std::string& name, std::string_view content) {
  std::string member = header_of(name, content.size());
  member.reserve(kTarBlock + content.size() + kTarBlock);
  member += content;
  member.append((kTarBlock - content.size() % kTarBlock) % kTarBlock, '\0');
  return member;
}

}  // namespace fringeslam::datasets

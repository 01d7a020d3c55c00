// SPDX-License-Identifier: Apache-2.0
// SHA-256 checksums (FIPS 180-4).
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace fringeslam::datasets {

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  void add(std::string_view bytes);
  // Returns the checksum of all bytes added, as 64 hexadecimal digits. Nothing may be added afterwards.
  std::string hex();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

std::string sha256_hex(std::string_view bytes);

}  // namespace fringeslam::datasets

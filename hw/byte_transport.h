// SPDX-License-Identifier: Apache-2.0
// Sends and receives byte reports; the layer below a device protocol, which tests replace by a transcript.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace fringeslam {

class ByteTransport {
 public:
  virtual ~ByteTransport() = default;
  virtual void write(const std::vector<uint8_t>& report) = 0;
  // Throws Error on timeout.
  virtual std::vector<uint8_t> read(double timeout_s) = 0;
};

// Opens a USB HID device with 64-byte reports. Throws Error if it is absent or cannot be opened; in the latter case the
// message contains the udev rule that grants permission.
std::unique_ptr<ByteTransport> open_hid(uint16_t vendor, uint16_t product, const std::string& name);

}  // namespace fringeslam

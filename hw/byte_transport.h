// SPDX-License-Identifier: Apache-2.0
// Reports of bytes to a device and back: what lies below a protocol, so that tests can write both sides of a talk.
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
  // Throws Error when nothing comes within the time.
  virtual std::vector<uint8_t> read(double timeout_s) = 0;
};

// A USB HID device, reports of 64 bytes. Throws Error when there is none, or when the user may not open it: then with
// the udev rule that permits it.
std::unique_ptr<ByteTransport> open_hid(uint16_t vendor, uint16_t product, const std::string& name);

}  // namespace fringeslam

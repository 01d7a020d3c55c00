// SPDX-License-Identifier: Apache-2.0
#include <hidapi/hidapi.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "core/types/error.h"
#include "hw/byte_transport.h"

namespace fringeslam {

namespace {

constexpr size_t kReport = 64;

std::string hex(uint16_t number) {
  char text[5];
  std::snprintf(text, sizeof text, "%04x", number);
  return text;
}

class HidTransport : public ByteTransport {
 public:
  HidTransport(hid_device* device, std::string name) : device_(device), name_(std::move(name)) {}
  ~HidTransport() override { hid_close(device_); }
  HidTransport(const HidTransport&) = delete;
  HidTransport& operator=(const HidTransport&) = delete;

  void write(const std::vector<uint8_t>& report) override {
    std::vector<uint8_t> bytes(1 + kReport, 0);  // the first byte is the report id
    std::copy_n(report.begin(), std::min(report.size(), kReport), bytes.begin() + 1);
    if (hid_write(device_, bytes.data(), bytes.size()) < 0) throw Error(name_ + ": rejects commands; unplugged?");
  }

  std::vector<uint8_t> read(double timeout_s) override {
    std::vector<uint8_t> bytes(kReport);
    const int count = hid_read_timeout(device_, bytes.data(), bytes.size(), static_cast<int>(1e3 * timeout_s));
    if (count <= 0) throw Error(name_ + ": does not reply; unplugged?");
    bytes.resize(static_cast<size_t>(count));
    return bytes;
  }

 private:
  hid_device* device_;
  std::string name_;
};

bool path_exists(uint16_t vendor, uint16_t product) {
  hid_device_info* all = hid_enumerate(vendor, product);
  hid_free_enumeration(all);
  return all != nullptr;
}

}  // namespace

std::unique_ptr<ByteTransport> open_hid(uint16_t vendor, uint16_t product, const std::string& name) {
  if (hid_device* device = hid_open(vendor, product, nullptr)) return std::make_unique<HidTransport>(device, name);
  if (!path_exists(vendor, product)) throw Error(name + ": not found on USB; is it powered and plugged in?");
  throw Error(name + ": cannot be opened; as root, write SUBSYSTEM==\"hidraw\", ATTRS{idVendor}==\"" + hex(vendor) +
              "\", ATTRS{idProduct}==\"" + hex(product) +
              "\", MODE=\"0666\" to /etc/udev/rules.d/60-projector.rules and reconnect it");
}

}  // namespace fringeslam

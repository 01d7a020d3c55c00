// SPDX-License-Identifier: Apache-2.0
// The DLPC350 controller of LightCrafter 4500 projectors, by its USB commands (Texas Instruments, DLPC350 Programmer's
// Guide, DLPU010G). In pattern display mode it shows what comes over the video port as it is: no gamma, no colour
// sequence, no scaling; so its light is what the pattern means.
//
// A report is flags (read 0xC0, write 0x00; 0x20 in an answer: refused), a sequence number, the length of what follows
// (two bytes, the lower first), the command (CMD3, CMD2), data.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "hw/byte_transport.h"

namespace fringeslam {

struct Dlpc350Settings {
  int period_us = 16666;     // of the frames of the video port
  int exposure_us = 16666;   // of a pattern: at least 8333 for 8 bits, 4500 for 7; its period, or 230 less
  int led_current = -1;      // 0 to 255 of each; -1: left as it is
  std::string packing = {};  // such as "RGB": a frame is three patterns of 7 bits, these channels; empty: one of 8 bits

  int pattern_period_us() const { return packing.empty() ? period_us : period_us / 3; }
};

struct Dlpc350Status {
  bool initialised = false, sequence_running = false, frozen = false;
  std::string faults;  // in words; empty: none
};

class Dlpc350 {
 public:
  static constexpr uint16_t kVendor = 0x0451, kProduct = 0x6401;

  explicit Dlpc350(std::unique_ptr<ByteTransport> transport);
  // Stops the patterns: back to video.
  ~Dlpc350();
  Dlpc350(const Dlpc350&) = delete;
  Dlpc350& operator=(const Dlpc350&) = delete;

  // Shows each frame of the video port as one pattern or three, by all LEDs, from its vertical sync on, each with a
  // pulse on trigger output 1 for as long as it is shown. Throws Error
  // when the controller refuses, with what it finds invalid in words. `wait`: between looks at whether it is done.
  void show_video_as_patterns(const Dlpc350Settings& settings, const std::function<void()>& wait);

  Dlpc350Status status();

 private:
  void write(uint16_t command, const std::vector<uint8_t>& data);
  std::vector<uint8_t> read(uint16_t command);

  std::unique_ptr<ByteTransport> transport_;
  uint8_t sequence_ = 0;
  bool patterns_ = false;
};

// The one on USB. Throws Error when there is none, or when the user may not open it.
Dlpc350 open_dlpc350();

// What the controller says of a pattern sequence; empty: nothing is wrong.
std::string validation_faults(uint8_t status);

}  // namespace fringeslam

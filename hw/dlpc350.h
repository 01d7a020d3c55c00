// SPDX-License-Identifier: Apache-2.0
// The DLPC350 controller of LightCrafter 4500 projectors, by its USB commands (Texas Instruments, DLPC350 Programmer's
// Guide, DLPU010G). In pattern display mode it shows the video input unchanged, without gamma, colour sequence or
// scaling, so the emitted light is proportional to the pattern.
//
// Report layout: flags (read 0xC0, write 0x00; 0x20 in a reply: rejected), sequence number, length of the remainder
// (two bytes, little-endian), command (CMD3, CMD2), data.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "hw/byte_transport.h"

namespace fringeslam {

struct Dlpc350Settings {
  int period_us = 16666;     // frame period of the video port
  int exposure_us = 16666;   // per pattern: at least 8333 for 8 bits, 4500 for 7; the pattern period or 230 less
  int led_current = -1;      // 0 to 255 for each LED; -1: unchanged
  std::string packing = {};  // e.g. "RGB": three 7-bit patterns per frame, in these channels; empty: one 8-bit

  int pattern_period_us() const { return packing.empty() ? period_us : period_us / 3; }
};

struct Dlpc350Status {
  bool initialised = false, sequence_running = false, frozen = false;
  std::string faults;  // plain text; empty: none
};

class Dlpc350 {
 public:
  static constexpr uint16_t kVendor = 0x0451, kProduct = 0x6401;

  explicit Dlpc350(std::unique_ptr<ByteTransport> transport);
  // Stops the patterns and returns to video mode.
  ~Dlpc350();
  Dlpc350(const Dlpc350&) = delete;
  Dlpc350& operator=(const Dlpc350&) = delete;

  // Shows each frame of the video port, starting at its vertical sync, as one or three patterns with all LEDs, each
  // with a pulse on trigger output 1 while it is shown. Throws Error with the invalid settings if the controller
  // rejects them. `wait` is called between polls of the validation.
  void show_video_as_patterns(const Dlpc350Settings& settings, const std::function<void()>& wait);

  Dlpc350Status status();

 private:
  void write(uint16_t command, const std::vector<uint8_t>& data);
  std::vector<uint8_t> read(uint16_t command);

  std::unique_ptr<ByteTransport> transport_;
  uint8_t sequence_ = 0;
  bool patterns_ = false;
};

// Opens the controller on USB. Throws Error if it is absent or cannot be opened.
Dlpc350 open_dlpc350();

// Describes the faults in a validation status byte; empty if there are none.
std::string validation_faults(uint8_t status);

}  // namespace fringeslam

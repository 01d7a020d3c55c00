// SPDX-License-Identifier: Apache-2.0
#include "hw/dlpc350.h"

#include <array>
#include <utility>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// CMD2 and CMD3 from DLPU010G, section 2.
enum Command : uint16_t {
  kLedCurrent = 0x0B01,
  kHardwareStatus = 0x1A0A,
  kSystemStatus = 0x1A0B,
  kMainStatus = 0x1A0C,
  kValidate = 0x1A1A,
  kDisplayMode = 0x1A1B,
  kTriggerOutput1 = 0x1A1D,
  kPatternSource = 0x1A22,
  kTriggerMode = 0x1A23,
  kStartStop = 0x1A24,
  kExposurePeriod = 0x1A29,
  kPatternConfig = 0x1A31,
  kMailboxAddress = 0x1A32,
  kMailbox = 0x1A33,
  kMailboxData = 0x1A34
};

constexpr uint8_t kReadFlags = 0xC0, kWriteFlags = 0x00, kRefused = 0x20;
constexpr double kAnswer_s = 2;
constexpr uint8_t kNoDelay = 0xBB;

std::string joined(const std::string& words, const std::string& more) {
  return words.empty() ? more : words + "; " + more;
}

// One entry per pattern: trigger source and pattern number; bit depth and LEDs; flags. Patterns of 7 or 8 bits are
// numbered 0 green, 1 red, 2 blue. The first pattern waits for the vertical sync and reads the frame, the others
// follow.
std::vector<std::array<uint8_t, 3>> pattern_table(const std::string& packing) {
  constexpr uint8_t kBySync = 1, kByPrevious = 3, kAllLeds = 7 << 4, kNewFrame = 1 << 2;
  if (packing.empty()) return {{kBySync, kAllLeds | 8, kNewFrame}};
  std::vector<std::array<uint8_t, 3>> table;
  for (const char channel : packing) {
    const size_t number = std::string("GRB").find(channel);
    if (number == std::string::npos) throw Error("projector: packing " + packing + " contains an unknown channel");
    const bool first = table.empty();
    table.push_back({static_cast<uint8_t>(number << 2 | (first ? kBySync : kByPrevious)), kAllLeds | 7,
                     first ? kNewFrame : uint8_t{0}});
  }
  return table;
}

std::vector<uint8_t> bytes_of(uint32_t value) {
  return {static_cast<uint8_t>(value), static_cast<uint8_t>(value >> 8), static_cast<uint8_t>(value >> 16),
          static_cast<uint8_t>(value >> 24)};
}

}  // namespace

std::string validation_faults(uint8_t status) {
  static const char* const kFaults[] = {"the exposure or the period is out of range", "a pattern's number is invalid",
                                        "trigger output 1 would be on continuously, or black sectors overlap",
                                        "black is missing before an externally triggered pattern",
                                        "the period exceeds the exposure by less than 230 us"};
  std::string faults;
  for (int bit = 0; bit < 5; ++bit) {
    if (status >> bit & 1) faults = joined(faults, kFaults[bit]);
  }
  return faults;
}

Dlpc350 open_dlpc350() { return Dlpc350(open_hid(Dlpc350::kVendor, Dlpc350::kProduct, "projector controller")); }

Dlpc350::Dlpc350(std::unique_ptr<ByteTransport> transport) : transport_(std::move(transport)) {}

Dlpc350::~Dlpc350() {
  if (!patterns_) return;
  try {
    write(kStartStop, {0});
    write(kDisplayMode, {0});
  } catch (const Error&) {  // unplugged: nothing to restore
  }
}

void Dlpc350::write(uint16_t command, const std::vector<uint8_t>& data) {
  const size_t length = data.size() + 2;
  std::vector<uint8_t> report = {kWriteFlags,
                                 sequence_++,
                                 static_cast<uint8_t>(length),
                                 static_cast<uint8_t>(length >> 8),
                                 static_cast<uint8_t>(command),
                                 static_cast<uint8_t>(command >> 8)};
  report.insert(report.end(), data.begin(), data.end());
  transport_->write(report);
}

std::vector<uint8_t> Dlpc350::read(uint16_t command) {
  const uint8_t number = sequence_++;
  transport_->write({kReadFlags, number, 2, 0, static_cast<uint8_t>(command), static_cast<uint8_t>(command >> 8)});
  // Skips pending replies to earlier requests.
  for (int i = 0; i < 8; ++i) {
    std::vector<uint8_t> report = transport_->read(kAnswer_s);
    if (report.size() < 5) throw Error("projector: the controller's reply is too short");
    if (report[1] != number) continue;
    if (report[0] & kRefused) throw Error("projector: the controller rejects a request");
    return {report.begin() + 4, report.end()};
  }
  throw Error("projector: the controller replies to other requests than the one sent");
}

void Dlpc350::show_video_as_patterns(const Dlpc350Settings& settings, const std::function<void()>& wait) {
  if (settings.led_current >= 0) {
    const auto current = static_cast<uint8_t>(settings.led_current);
    write(kLedCurrent, {current, current, current});
  }
  write(kStartStop, {0});
  write(kDisplayMode, {1});
  patterns_ = true;
  const std::vector<std::array<uint8_t, 3>> table = pattern_table(settings.packing);
  const auto last = static_cast<uint8_t>(table.size() - 1);
  write(kPatternSource, {0});                       // the video port
  write(kPatternConfig, {last, 1, last, 0});        // the whole table, repeated; counts minus one
  write(kTriggerOutput1, {0, kNoDelay, kNoDelay});  // high while the pattern is shown
  std::vector<uint8_t> times = bytes_of(static_cast<uint32_t>(settings.exposure_us));
  const std::vector<uint8_t> period = bytes_of(static_cast<uint32_t>(settings.pattern_period_us()));
  times.insert(times.end(), period.begin(), period.end());
  write(kExposurePeriod, times);
  write(kTriggerMode, {0});  // vertical sync
  write(kMailbox, {2});
  write(kMailboxAddress, {0});
  std::vector<uint8_t> entries;
  for (const auto& entry : table) entries.insert(entries.end(), entry.begin(), entry.end());
  write(kMailboxData, entries);
  write(kMailbox, {0});
  write(kValidate, {});
  constexpr int kMostLooks = 100;
  constexpr uint8_t kBusy = 0x80;
  for (int look = 0; look < kMostLooks; ++look) {
    const uint8_t found = read(kValidate).front();
    if (found & kBusy) {
      wait();
      continue;
    }
    if (const std::string faults = validation_faults(found); !faults.empty())
      throw Error("projector: the controller rejects the patterns: " + faults);
    write(kStartStop, {2});
    return;
  }
  throw Error("projector: the controller does not finish validating the patterns");
}

Dlpc350Status Dlpc350::status() {
  const uint8_t hardware = read(kHardwareStatus).front(), system = read(kSystemStatus).front(),
                main = read(kMainStatus).front();
  Dlpc350Status status;
  status.initialised = hardware & 0x01;
  status.sequence_running = main & 0x02;
  status.frozen = main & 0x04;
  if (!status.initialised) status.faults = joined(status.faults, "initialisation failed");
  if (hardware & 0x04) status.faults = joined(status.faults, "the DMD reset controller reports an error");
  if (hardware & 0x08) status.faults = joined(status.faults, "forced swap error");
  if (hardware & 0x40) status.faults = joined(status.faults, "the sequencer was aborted");
  if (hardware & 0x80) status.faults = joined(status.faults, "the sequencer reports an error");
  if (!(system & 0x01)) status.faults = joined(status.faults, "the memory test failed");
  if (main & 0x01) status.faults = joined(status.faults, "the mirrors are parked");
  return status;
}

}  // namespace fringeslam

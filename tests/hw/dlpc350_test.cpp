// SPDX-License-Identifier: Apache-2.0
#include "hw/dlpc350.h"

#include <gmock/gmock.h>

#include <deque>

#include "core/types/error.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;
using Bytes = std::vector<uint8_t>;

// Transcript of both sides: reports received by the controller, and its prepared replies.
struct Talk {
  std::vector<Bytes> sent;
  std::deque<Bytes> says;
};

class Transcript : public ByteTransport {
 public:
  explicit Transcript(Talk& talk) : talk_(talk) {}
  void write(const Bytes& report) override { talk_.sent.push_back(report); }
  Bytes read(double) override {
    if (talk_.says.empty()) throw Error("no reply");
    Bytes report = talk_.says.front();
    talk_.says.pop_front();
    report[1] = talk_.sent.back()[1];
    return report;
  }

 private:
  Talk& talk_;
};

Bytes answer(uint8_t value) { return {0xC0, 0, 3, 0, value}; }

// Removes the sequence number from a report.
Bytes plain(Bytes report) {
  report.erase(report.begin() + 1);
  return report;
}

TEST(Dlpc350, VideoAsPatternsIsThisTalk) {
  Talk talk;
  talk.says = {answer(0x80), answer(0x00)};
  int waits = 0;
  {
    Dlpc350 controller(std::make_unique<Transcript>(talk));
    controller.show_video_as_patterns({.period_us = 16666, .exposure_us = 16000, .led_current = 100}, [&] { ++waits; });
  }
  EXPECT_EQ(waits, 1);
  const std::vector<Bytes> expected = {
      {0x00, 5, 0, 0x01, 0x0B, 100, 100, 100},                        // LED currents
      {0x00, 3, 0, 0x24, 0x1A, 0},                                    // stop
      {0x00, 3, 0, 0x1B, 0x1A, 1},                                    // pattern display mode
      {0x00, 3, 0, 0x22, 0x1A, 0},                                    // from the video port
      {0x00, 6, 0, 0x31, 0x1A, 0, 1, 0, 0},                           // one entry, repeated
      {0x00, 5, 0, 0x1D, 0x1A, 0, 0xBB, 0xBB},                        // trigger output 1, no delays
      {0x00, 10, 0, 0x29, 0x1A, 0x80, 0x3E, 0, 0, 0x1A, 0x41, 0, 0},  // 16000 us of 16666 us
      {0x00, 3, 0, 0x23, 0x1A, 0},                                    // vertical sync
      {0x00, 3, 0, 0x33, 0x1A, 2},                                    // mailbox: pattern definitions
      {0x00, 3, 0, 0x32, 0x1A, 0},                                    // at 0
      {0x00, 5, 0, 0x34, 0x1A, 0x01, 0x78, 0x04},                     // pattern 0, 8 bits, white, buffer swap
      {0x00, 3, 0, 0x33, 0x1A, 0},                                    // close
      {0x00, 2, 0, 0x1A, 0x1A},                                       // validate
      {0xC0, 2, 0, 0x1A, 0x1A},                                       // poll: busy
      {0xC0, 2, 0, 0x1A, 0x1A},                                       // poll: done
      {0x00, 3, 0, 0x24, 0x1A, 2},                                    // start
      {0x00, 3, 0, 0x24, 0x1A, 0},                                    // destructor: stop
      {0x00, 3, 0, 0x1B, 0x1A, 0}};                                   // back to video
  ASSERT_EQ(talk.sent.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(plain(talk.sent[i]), expected[i]) << i;
    EXPECT_EQ(talk.sent[i][1], i) << "sequence number";
  }
}

TEST(Dlpc350, AFrameOfThreePatternsShowsItsChannelsInOrder) {
  Talk talk;
  talk.says = {answer(0x00)};
  Dlpc350 controller(std::make_unique<Transcript>(talk));
  controller.show_video_as_patterns({.period_us = 16666, .exposure_us = 5300, .packing = "RGB"}, [] {});
  std::vector<Bytes> sent;
  for (const Bytes& report : talk.sent) sent.push_back(plain(report));
  EXPECT_THAT(sent,
              testing::IsSupersetOf(std::vector<Bytes>{
                  {0x00, 6, 0, 0x31, 0x1A, 2, 1, 2, 0},                           // three entries
                  {0x00, 10, 0, 0x29, 0x1A, 0xB4, 0x14, 0, 0, 0xB3, 0x15, 0, 0},  // 5300 us of a third of 16666 us
                  // 7 bits, white light: red at the sync with a new frame, then green, then blue
                  {0x00, 11, 0, 0x34, 0x1A, 0x05, 0x77, 0x04, 0x03, 0x77, 0x00, 0x0B, 0x77, 0x00}}));
}

TEST(Dlpc350, InvalidSettingsAreReportedInWords) {
  for (const auto& [status, words] : std::vector<std::pair<uint8_t, const char*>>{
           {0x01, "exposure or the period"}, {0x02, "pattern's number"}, {0x10, "by less than 230 us"}}) {
    Talk talk;
    talk.says = {answer(status)};
    Dlpc350 controller(std::make_unique<Transcript>(talk));
    EXPECT_THAT(error_of([&] { controller.show_video_as_patterns({}, [] {}); }), HasSubstr(words));
    EXPECT_NE(plain(talk.sent.back()), (Bytes{0x00, 3, 0, 0x24, 0x1A, 2})) << "started despite the fault";
  }
  EXPECT_EQ(validation_faults(0), "");
  EXPECT_THAT(validation_faults(0x03), HasSubstr("; "));
}

TEST(Dlpc350, EndlessValidationEnds) {
  Talk talk;
  talk.says.assign(1000, answer(0x80));
  Dlpc350 controller(std::make_unique<Transcript>(talk));
  EXPECT_THAT(error_of([&] { controller.show_video_as_patterns({}, [] {}); }), HasSubstr("does not finish validating"));
}

TEST(Dlpc350, StatusInWords) {
  Talk talk;
  talk.says = {answer(0x01), answer(0x01), answer(0x02)};
  Dlpc350 controller(std::make_unique<Transcript>(talk));
  const Dlpc350Status good = controller.status();
  EXPECT_TRUE(good.initialised && good.sequence_running && !good.frozen);
  EXPECT_EQ(good.faults, "");
  talk.says = {answer(0x84), answer(0x00), answer(0x01)};
  const Dlpc350Status bad = controller.status();
  EXPECT_FALSE(bad.initialised);
  for (const char* words : {"initialisation failed", "reset controller", "sequencer reports", "memory test", "parked"})
    EXPECT_THAT(bad.faults, HasSubstr(words));
}

TEST(Dlpc350, RefusalsSilenceAndTornAnswers) {
  Talk talk;
  Dlpc350 controller(std::make_unique<Transcript>(talk));
  EXPECT_THAT(error_of([&] { (void)controller.status(); }), HasSubstr("no reply"));
  talk.says = {{0xE0, 0, 3, 0, 1}};
  EXPECT_THAT(error_of([&] { (void)controller.status(); }), HasSubstr("rejects a request"));
  talk.says = {{0xC0, 0}};
  EXPECT_THAT(error_of([&] { (void)controller.status(); }), HasSubstr("too short"));
}

}  // namespace
}  // namespace fringeslam

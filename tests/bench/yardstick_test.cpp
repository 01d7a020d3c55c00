// SPDX-License-Identifier: Apache-2.0
#include "bench/yardstick.h"

#include <gtest/gtest.h>

namespace fringeslam::bench {
namespace {

Row row(const std::string& id, double value, const std::string& unit, double limit, Limit direction) {
  return {id, value, unit, 1, value, value, limit, direction, false};
}

TEST(Yardstick, ASlowMachineMayTakeLonger) {
  Row time = row("speed.points", 4, "ms", 3, Limit::most), rate = row("speed.frame", 20, "frames/s", 30, Limit::least);
  scale(time, 1);
  scale(rate, 1);
  EXPECT_FALSE(time.pass);
  EXPECT_FALSE(rate.pass);
  scale(time, 2);
  scale(rate, 2);
  EXPECT_TRUE(time.pass);
  EXPECT_TRUE(rate.pass);
  EXPECT_EQ(time.value, 4) << "the value is reported as measured";
  EXPECT_EQ(time.scaled, 2);
  EXPECT_EQ(rate.scaled, 40);
}

TEST(Yardstick, AFastMachineHasToBeFaster) {
  Row time = row("speed.points", 2, "ms", 3, Limit::most);
  scale(time, 0.5);
  EXPECT_FALSE(time.pass);
}

TEST(Yardstick, RatiosAndOtherMeasurementsStayAsTheyAre) {
  EXPECT_TRUE(depends_on_machine(row("speed.points", 2, "ms", 3, Limit::most)));
  EXPECT_FALSE(depends_on_machine(row("speed.decode", 120, "x", 100, Limit::least)));
  EXPECT_FALSE(depends_on_machine(row("speed.worlds.memory", 900, "MiB", 1024, Limit::most)));
  EXPECT_FALSE(depends_on_machine(row("moving.ate", 0.1, "mm", 0.3, Limit::most)));
}

// The machine is slower for a program that has to share its cores, but not infinitely.
TEST(Yardstick, IsPositive) {
  const double yardstick = measure_yardstick();
  EXPECT_GT(yardstick, 0.05);
  EXPECT_LT(yardstick, 1000);
}

}  // namespace
}  // namespace fringeslam::bench

// SPDX-License-Identifier: Apache-2.0
#include "core/types/trajectory.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

#include "core/io/tum_file.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::PoseNear;
using testing::HasSubstr;

// A file deleted at the end of the test; named after the test, since ctest runs tests in parallel.
class TumFile : public testing::Test {
 protected:
  TumFile() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    file_ = std::filesystem::path(testing::TempDir()) / (std::string("fringeslam_") + info->name() + ".tum");
  }
  ~TumFile() override { std::filesystem::remove(file_); }

  std::filesystem::path write(const std::string& text) const {
    std::ofstream(file_, std::ios::binary) << text;
    return file_;
  }
  std::string error(const std::string& text) const {
    return error_of([&] { read_tum(write(text)); });
  }

 private:
  std::filesystem::path file_;
};

constexpr const char* kGood = "1.5 1 2 3 0 0 0 1\n";

TEST_F(TumFile, RoundTrip) {
  support::Random random(1);
  Trajectory trajectory;
  for (int i = 0; i < 50; ++i)
    trajectory.push_back(
        {1.7e9 + i / 30.0, {rotation_exp(random.uniform(0, 3.14) * random.direction()), random.normals<3>()}});
  const Trajectory back = read_tum(write(to_tum(trajectory)));
  ASSERT_EQ(back.size(), trajectory.size());
  for (size_t i = 0; i < back.size(); ++i) {
    EXPECT_NEAR(back[i].timestamp_s, trajectory[i].timestamp_s, 1e-6);
    EXPECT_THAT(back[i].world_from_robot, PoseNear(trajectory[i].world_from_robot, 1e-11, 1e-14));
  }
}

TEST_F(TumFile, FormatIsTimestampTranslationQuaternion) {
  const Trajectory one = {{0.5, {rotation_exp({3.14159265358979312, 0, 0}), {1, -2, 3.25}}}};
  EXPECT_THAT(to_tum(one), testing::MatchesRegex("0.500000000 1 -2 3.25 1 0 0 [0-9.e-]+\n"));
}

TEST_F(TumFile, SkipsCommentsBlankLinesAndCarriageReturns) {
  const Trajectory read =
      read_tum(write("# timestamp tx ty tz qx qy qz qw\r\n\r\n1.5 1 2 3 0 0 0 1\r\n  \n2 0 0 0 0 0 0 1 # home"));
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].timestamp_s, 1.5);
  EXPECT_EQ(read[0].world_from_robot.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(read[1].timestamp_s, 2);
}

TEST_F(TumFile, ErrorsNameFileLineAndReason) {
  const std::string good = kGood;
  EXPECT_THAT(error(good + "# c\n2 1 2 3 0 0 0\n"), HasSubstr(".tum:3: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2 1 x 3 0 0 0 1\n"), HasSubstr(".tum:2: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2 1 nan 3 0 0 0 1\n"), HasSubstr(".tum:2: needs eight finite numbers"));
  EXPECT_THAT(error("2 1 2 3 0 0 0 1 9\n"), HasSubstr(".tum:1: has more than eight numbers: '9'"));
  EXPECT_THAT(error("2 1 2 3 0 0 0 1.01\n"), HasSubstr(".tum:1: the quaternion is not of unit length"));
  EXPECT_THAT(error(good + "1.5 1 2 3 0 0 0 1\n"), HasSubstr(".tum:2: timestamps must increase"));
  EXPECT_THAT(error("# nothing\n"), HasSubstr("contains no pose"));
}

TEST_F(TumFile, MissingFileIsAnError) {
  EXPECT_THAT(error_of([] { read_tum("/nowhere/at/all.tum"); }), HasSubstr("/nowhere/at/all.tum: cannot be opened"));
}

}  // namespace
}  // namespace fringeslam

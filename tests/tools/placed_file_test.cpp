// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/placed_file.h"

#include <gmock/gmock.h>

#include <cmath>

#include "core/io/staged.h"
#include "core/io/yaml.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::tools {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

class PlacedFile : public testing::Test {
 protected:
  std::vector<double> position(const std::string& path) const {
    return YamlMap::load(file()).map("placed").numbers(path, 3, {-1e4, 1e4});
  }
  std::filesystem::path file() const { return temp_ / kPlacedFile; }

  test::TempFolder temp_;
};

TEST_F(PlacedFile, KeepsOtherEntriesAndReplacesItsOwn) {
  create_placed(temp_ / "");
  EXPECT_TRUE(YamlMap::load(file()).map("placed").keys().empty());
  place(temp_ / "", "objects.2.pose.translation_m", {0.1, -0.25, 1e-9});
  place(temp_ / "", "trajectory.spline.waypoints.0.camera_m", {1, 2, 3});
  place(temp_ / "", "objects.2.pose.translation_m", {0.30004, 0, -1e-6});
  EXPECT_THAT(YamlMap::load(file()).map("placed").keys(),
              ElementsAre("objects.2.pose.translation_m", "trajectory.spline.waypoints.0.camera_m"));
  EXPECT_THAT(position("objects.2.pose.translation_m"), ElementsAre(0.3, 0, 0));
  EXPECT_THAT(position("trajectory.spline.waypoints.0.camera_m"), ElementsAre(1, 2, 3));
  create_placed(temp_ / "");
  EXPECT_THAT(position("objects.2.pose.translation_m"), ElementsAre(0.3, 0, 0));
}

TEST_F(PlacedFile, IsNotReplacedUnlessItIsItsOwn) {
  const std::string mine = "placed: {}\n";
  write_text(file(), mine);
  EXPECT_THAT(error_of([&] {
                place(temp_ / "", "objects.0.pose.translation_m", {0, 0, 0});
              }),
              HasSubstr("was not written by this program"));
  EXPECT_THAT(error_of([&] { create_placed(temp_ / ""); }), HasSubstr("was not written by this program"));
  EXPECT_EQ(test::read_bytes(file()), mine);
}

TEST_F(PlacedFile, IsNotReplacedIfItContainsAnotherSection) {
  place(temp_ / "", "objects.2.pose.translation_m", {0, 0, 1});
  const std::string both = test::read_bytes(file()) + "light: {ambient_lux: 90}\n";
  write_text(file(), both);
  const std::string expected = file().string() + ":5: 'light' would be lost";
  EXPECT_THAT(error_of([&] { place(temp_ / "", "objects.2.pose.translation_m", {0, 0, 2}); }), HasSubstr(expected));
  EXPECT_THAT(error_of([&] { create_placed(temp_ / ""); }), HasSubstr(expected));
  EXPECT_EQ(test::read_bytes(file()), both);
}

TEST_F(PlacedFile, TakesPositionsOnly) {
  for (const char* path : {"light.ambient_lux", "objects.0.size_m", "objects.x.pose.translation_m", "include",
                           "objects.0.pose.translation_m: 3\nname", ""})
    EXPECT_THAT(error_of([&] { place(temp_ / "", path, {0, 0, 0}); }), HasSubstr("is not the position")) << path;
  for (const double bad : {double{NAN}, double{INFINITY}, 2e4})
    EXPECT_THAT(error_of([&] {
                  place(temp_ / "", "trajectory.poses.3.translation_m", {0, bad, 0});
                }),
                HasSubstr("within 10 km"));
  EXPECT_FALSE(std::filesystem::exists(file()));
}

}  // namespace
}  // namespace fringeslam::tools

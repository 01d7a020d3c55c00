// SPDX-License-Identifier: Apache-2.0
#include "tools/run_phases.h"

#include <gmock/gmock.h>

#include <new>

#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using testing::ElementsAre;
using tools::RunPhases;

TEST(RunPhases, AnErrorOfAnyKindCostsOnlyItsPhase) {
  const test::TempFolder temp;
  RunPhases phases(temp.path(), true);
  for (const char* name : {"cloud", "surface", "report"}) test::write_bytes(temp / name, "half");
  phases.run("cloud", {"cloud"}, [] { throw Error("cloud: is bad"); });
  phases.run("surface", {"surface"}, [] { throw std::bad_alloc(); });
  bool ran = false;
  phases.run("report", {"report"}, [&] { ran = true; });
  EXPECT_TRUE(ran);
  ASSERT_EQ(phases.failures().size(), 2u);
  EXPECT_EQ(phases.failures()[0], "cloud: is bad");
  EXPECT_THAT(phases.failures()[1], testing::HasSubstr("memory"));
  EXPECT_THAT(phases.left_out(), ElementsAre("cloud", "surface"));
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"report"}));
}

}  // namespace
}  // namespace fringeslam

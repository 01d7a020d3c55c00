// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/suite_file.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::evaluation {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const std::filesystem::path kSuites = std::filesystem::path(FRINGESLAM_SOURCE_DIR) / "scenes/suites";

std::string error_of(const std::string& text) {
  const test::TempFolder temp;
  test::write_bytes(temp / "mine.yaml", text);
  try {
    read_suite(temp / "mine.yaml", kSuites);
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(SuiteFile, OneDatasetForEachSeed) {
  const test::TempFolder temp;
  test::write_bytes(temp / "mine.yaml",
                    "description: two\ntimeout_s: 7\nmemory_mib: 100\ndatasets:\n"
                    "  - {name: a, scene: scenes/a, seeds: 2, first_seed: 5}\n"
                    "  - {name: b, scene: b.yaml, with: [light.ambient_lux=0]}\n");
  const Suite suite = read_suite(temp / "mine.yaml", kSuites);
  EXPECT_EQ(suite.name, "mine");
  EXPECT_EQ(suite.timeout_s, 7);
  EXPECT_EQ(suite.memory_mib, 100);
  ASSERT_EQ(suite.datasets.size(), 3);
  EXPECT_EQ(suite.datasets[0].name, "a-5");
  EXPECT_EQ(suite.datasets[1].name, "a-6");
  EXPECT_EQ(suite.datasets[1].seed, 6);
  EXPECT_EQ(suite.datasets[0].scene, temp / "scenes/a");
  EXPECT_EQ(suite.datasets[2].name, "b-1");
  EXPECT_THAT(suite.datasets[2].with, ElementsAre("light.ambient_lux=0"));
}

TEST(SuiteFile, TheSuitesOfTheProjectHaveScenes) {
  for (const std::string name : {"stills", "moving", "smoke", "repeating", "arenas", "loop"}) {
    const Suite suite = read_suite(name, kSuites);
    EXPECT_FALSE(suite.description.empty()) << name;
    for (const SuiteDataset& dataset : suite.datasets)
      EXPECT_TRUE(std::filesystem::exists(dataset.scene / "scene.yaml")) << dataset.scene;
  }
}

TEST(SuiteFile, ErrorsNameTheLine) {
  EXPECT_THAT(error_of("datasets: []\n"), HasSubstr("'datasets' is empty"));
  EXPECT_THAT(error_of("datasets:\n  - {name: a, scene: a}\n  - {name: a, scene: b}\n"), HasSubstr("mine.yaml:3"));
  EXPECT_THAT(error_of("datasets:\n  - {name: ../a, scene: a}\n"), HasSubstr("letters"));
  EXPECT_THAT(error_of("datasets:\n  - {name: a, scene: a, seed: 3}\n"), HasSubstr("seed"));
  EXPECT_THAT(error_of("datasets:\n  - {name: a, scene: a, seeds: 0}\n"), HasSubstr("seeds"));
  EXPECT_THAT(error_of("timeout_s: -1\ndatasets:\n  - {name: a, scene: a}\n"), HasSubstr("timeout_s"));
}

TEST(SuiteFile, AnUnknownNameListsTheSuites) {
  try {
    read_suite("stil", kSuites);
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("arenas, loop, moving, repeating, smoke, stills"));
  }
}

TEST(SuiteFile, WithoutInstalledSuitesTheErrorSaysSo) {
  const test::TempFolder temp;
  try {
    read_suite("stills", temp / "none");
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("FRINGESLAM_DATA"));
  }
}

}  // namespace
}  // namespace fringeslam::evaluation

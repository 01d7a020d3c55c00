// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/spec.h"

#include <gmock/gmock.h>

#include <map>
#include <numeric>
#include <set>

#include "tests/datasets/dataset_files.h"

namespace fringeslam::datasets {
namespace {

using test::replaced;
using testing::AllOf;
using testing::HasSubstr;

Spec spec_of(int samples, int views, int worlds, int per_tar) {
  Spec spec;
  spec.samples = samples, spec.views = views, spec.worlds = worlds, spec.samples_per_tar = per_tar;
  spec.scenes = {"a", "b"};
  return spec;
}

TEST(DatasetSpec, EachTrialIsInOneTarFileOfTheSplitOfItsWorld) {
  const Spec spec = spec_of(600, 3, 40, 10);
  std::vector<int> trials;
  std::map<int, std::set<int>> splits_of_world;
  for (const Tar& tar : tars_of(spec)) {
    EXPECT_LE(tar.trials.size() * 3, 10u);
    for (const int trial : tar.trials) {
      EXPECT_EQ(tar.split, split_of(spec, trial % 40));
      splits_of_world[trial % 40].insert(tar.split);
    }
    trials.insert(trials.end(), tar.trials.begin(), tar.trials.end());
  }
  std::sort(trials.begin(), trials.end());
  std::vector<int> all(200);
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(trials, all);
  std::array<int, 3> worlds = {};
  for (const auto& [world, splits] : splits_of_world) {
    ASSERT_EQ(splits.size(), 1u) << world;
    ++worlds[static_cast<size_t>(*splits.begin())];
  }
  EXPECT_EQ(worlds, (std::array<int, 3>{32, 4, 4}));
}

TEST(DatasetSpec, AWorldHasOneSceneAndEachTrialDrawsRigAndPatterns) {
  Spec spec = spec_of(4000, 1, 10, 100);
  spec.rigs = {"r0", "r1"};
  spec.patterns = {"p0", "p1", "p2", "p3"};
  std::map<std::pair<int, int>, int> counts;
  for (int trial = 0; trial < spec.trials(); ++trial) {
    const Selection selected = selection_of(spec, trial);
    EXPECT_EQ(selected.scene, trial % 10 % 2);
    ++counts[{selected.rig, selected.patterns}];
  }
  ASSERT_EQ(counts.size(), 8u);
  // Four standard errors of a binomial count.
  for (const auto& [both, count] : counts) EXPECT_NEAR(count, 500, 4 * std::sqrt(4000 * 7.0 / 64)) << both.first;
  spec.rigs.clear(), spec.patterns.clear();
  EXPECT_EQ(selection_of(spec, 3).rig, -1);
  EXPECT_EQ(selection_of(spec, 3).patterns, -1);
}

TEST(DatasetSpec, IsReadAndChecked) {
  const test::TempFolder temp;
  const Spec spec = read_spec(test::write_dataset(temp.path()));
  EXPECT_EQ(spec.trials(), 6);
  EXPECT_EQ(spec.patterns[0], "{axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}");
  EXPECT_EQ(spec.patterns[1], "{axis: columns, steps: 4, periods_px: [131], gray: plain}");
  EXPECT_FALSE(spec.writes(Part::phase));
  EXPECT_TRUE(spec.writes(Part::sigma));
  const std::string identity = check_spec(spec);
  EXPECT_EQ(check_spec(read_spec(spec.file)), identity);
  // Quoted values do not change the samples; drawn values do.
  test::write_bytes(spec.file, replaced(test::kSmallDataset, "Boxes, for tests", "Other words"));
  EXPECT_EQ(check_spec(read_spec(spec.file)), identity);
  test::write_bytes(spec.file, replaced(test::kSmallDataset, "[10, 1000]", "[10, 1001]"));
  EXPECT_NE(check_spec(read_spec(spec.file)), identity);
}

TEST(DatasetSpec, ReportsTheLineOfAnError) {
  struct Case {
    const char *what, *by;
    int line;
    const char* says;
  };
  const std::vector<Case> cases = {
      {"views: 2", "veiws: 2", 5, "did you mean 'views'"},
      {"samples: 12", "samples: 13", 4, "multiple of 'views'"},
      {"scene.yaml", "nowhere.yaml", 3, "'nowhere.yaml' is neither"},
      {"worlds: 3", "worlds: 7", 6, "use only 6 worlds"},
      {"views: 2", "views: 4", 3, "fewer than 'views'"},
      {"test: 0.33", "test: 0.3", 9, "add up to 1"},
      {"validation: 0, test: 0.33", "validation: 0.02, test: 0.31", 9, "3 worlds leave none for validation"},
      {"test: 0.33", "tset: 0.33", 9, "did you mean 'test'"},
      {"gray: plain", "grey: plain", 12, "did you mean 'gray'"},
      {"steps: 3", "steps: 2", 11, "'steps'"},
      {"light.ambient_lux", "light.ambiant_lux", 14, "did you mean 'ambient_lux'"},
      {"light.ambient_lux", "lihgt.ambient_lux", 14, "unknown key 'lihgt'; did you mean 'light'?"},
      {"samples_per_tar: 4", "write: [images, dept]", 8, "did you mean 'depth'"},
      {"samples_per_tar: 4", "write: [images, thermal]", 8, "'thermal' needs a thermal camera"},
      {"samples_per_tar: 4", "rigs: [none.yaml]", 8, "does not exist"},
      {"samples_per_tar: 4", "publication: {license: a, url: b, creator: c, date: today}", 8, "2026-01-31"}};
  for (const Case& c : cases) {
    const test::TempFolder temp;
    const auto file = test::write_dataset(temp.path(), replaced(test::kSmallDataset, c.what, c.by));
    const std::string message = test::message_of([&] { (void)check_spec(read_spec(file)); });
    EXPECT_THAT(message, AllOf(HasSubstr(file.string() + ":" + std::to_string(c.line) + ": "), HasSubstr(c.says)))
        << c.by;
  }
}

}  // namespace
}  // namespace fringeslam::datasets

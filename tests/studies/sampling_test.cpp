// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <cmath>
#include <map>

#include "bench/studies/study.h"
#include "core/types/error.h"
#include "tests/studies/study_files.h"
#include "tests/support/matchers.h"

namespace fringeslam::studies {
namespace {

using support::error_of;
using test::replaced;
using testing::AllOf;
using testing::HasSubstr;

Parameter number(const std::string& name, Parameter::Law law, double a, double b) {
  Parameter parameter;
  parameter.name = name;
  parameter.law = law;
  parameter.a = a, parameter.b = b;
  return parameter;
}

Study study_of(std::vector<Parameter> parameters, int trials) {
  Study study;
  study.parameters = std::move(parameters);
  study.trials = trials;
  return study;
}

TEST(Sampling, DrawsFollowTheirLaws) {
  Parameter choice;
  choice.name = "c", choice.law = Parameter::Law::choice, choice.values = {"x", "y", "z"};
  Parameter whole = number("w", Parameter::Law::uniform, 0.5, 3.5);
  whole.whole = true;
  const int n = 4000;
  const Study study =
      study_of({number("u", Parameter::Law::uniform, 2, 4), number("l", Parameter::Law::log_uniform, 1, 100),
                number("n", Parameter::Law::normal, 5, 2), choice, whole},
               n);
  double mean_u = 0, mean_l = 0, mean_n = 0, square_n = 0;
  std::map<std::string, int> counts, wholes;
  for (int i = 0; i < n; ++i) {
    const Trial trial = trial_of(study, i);
    const double u = std::stod(trial.values[0]), l = std::stod(trial.values[1]), g = std::stod(trial.values[2]);
    EXPECT_TRUE(u >= 2 && u <= 4 && l >= 1 && l <= 100);
    mean_u += u / n, mean_l += std::log10(l) / n, mean_n += g / n, square_n += (g - 5) * (g - 5) / n;
    ++counts[trial.values[3]], ++wholes[trial.values[4]];
  }
  // Four standard errors.
  EXPECT_NEAR(mean_u, 3, 4 * 2 / std::sqrt(12.0 * n));
  EXPECT_NEAR(mean_l, 1, 4 * 2 / std::sqrt(12.0 * n));
  EXPECT_NEAR(mean_n, 5, 4 * 2 / std::sqrt(n));
  EXPECT_NEAR(square_n, 4, 4 * 4 * std::sqrt(2.0 / n));
  for (const char* value : {"x", "y", "z"}) EXPECT_NEAR(counts[value], n / 3.0, 4 * std::sqrt(n * 2 / 9.0)) << value;
  for (const char* value : {"1", "2", "3"}) EXPECT_NEAR(wholes[value], n / 3.0, 4 * std::sqrt(n * 2 / 9.0)) << value;
}

TEST(Sampling, ATrialDependsOnNoOtherParameterAndOnNoOrder) {
  const Parameter a = number("a", Parameter::Law::uniform, 0, 1), b = number("b", Parameter::Law::uniform, 0, 1);
  const Study alone = study_of({a}, 10), both = study_of({b, a}, 10);
  for (int i = 9; i >= 0; --i) {
    EXPECT_EQ(trial_of(alone, i).values[0], trial_of(both, i).values[1]);
    EXPECT_NE(trial_of(both, i).values[0], trial_of(both, i).values[1]);
    EXPECT_EQ(trial_of(alone, i).world_seed, trial_of(both, i).world_seed);
  }
  EXPECT_NE(trial_of(alone, 0).values[0], trial_of(alone, 1).values[0]);
  EXPECT_NE(trial_of(alone, 0).world_seed, trial_of(alone, 1).world_seed);
}

TEST(Sampling, GridsAreWalkedThroughEvenly) {
  Parameter p, q;
  p.name = "p", p.law = Parameter::Law::grid, p.values = {"1", "2"};
  q.name = "q", q.law = Parameter::Law::grid, q.values = {"a", "b", "c"};
  const Study study = study_of({p, q}, 24);
  std::map<std::pair<std::string, std::string>, int> cells;
  for (int i = 0; i < study.trials; ++i) ++cells[{trial_of(study, i).values[0], trial_of(study, i).values[1]}];
  EXPECT_EQ(cells.size(), 6u);
  for (const auto& [cell, count] : cells) EXPECT_EQ(count, 4) << cell.first << cell.second;
}

// Differences between values must not be those between scenes.
TEST(Sampling, EachGridValueMeetsEachWorld) {
  for (const auto& [values, worlds] : {std::pair{4, 4}, {4, 6}, {3, 5}, {2, 1}, {9, 3}}) {
    Parameter grid;
    grid.name = "p", grid.law = Parameter::Law::grid;
    for (int k = 0; k < values; ++k) grid.values.push_back(std::to_string(k));
    Study study = study_of({grid}, 2 * values * worlds);
    study.worlds = worlds;
    std::map<std::pair<std::string, int>, int> pairs;
    for (int i = 0; i < study.trials; ++i) ++pairs[{trial_of(study, i).values[0], world_of(study, i)}];
    EXPECT_EQ(pairs.size(), static_cast<size_t>(values * worlds)) << values << ' ' << worlds;
    for (const auto& [pair, count] : pairs) EXPECT_EQ(count, 2) << pair.first << ' ' << pair.second;
  }
}

TEST(Sampling, RowsOfASaltelliDesignShareWhatTheyShould) {
  Study study = study_of({number("a", Parameter::Law::uniform, 0, 1), number("b", Parameter::Law::uniform, 0, 1)}, 8);
  study.design = Design::saltelli;
  ASSERT_EQ(row_length(study), 4);
  for (int row = 0; row < 2; ++row) {
    std::vector<Trial> t;
    for (int k = 0; k < 4; ++k) t.push_back(trial_of(study, 4 * row + k));
    EXPECT_NE(t[0].values, t[1].values);
    EXPECT_EQ(t[2].values, (std::vector<std::string>{t[1].values[0], t[0].values[1]}));
    EXPECT_EQ(t[3].values, (std::vector<std::string>{t[0].values[0], t[1].values[1]}));
    for (const Trial& trial : t) EXPECT_EQ(trial.world_seed, t[0].world_seed);
  }
}

TEST(StudyFile, IsReadAndItsCommandSaysTheSame) {
  const test::TempFolder temp;
  const Study study = read_study(test::write_study(temp.path()));
  EXPECT_EQ(study.parameters.size(), 2u);
  EXPECT_FALSE(study.parameters[0].setting);
  EXPECT_TRUE(study.parameters[1].setting);
  EXPECT_NO_THROW(check_study(study));
  const Trial trial = trial_of(study, 3);
  EXPECT_EQ(command_of(study, trial), "fringeslam run '" + study.scene.string() + "' --seed " +
                                          std::to_string(trial.world_seed) +
                                          " --with 'objects.1.count=6' --with 'light.ambient_lux=" + trial.values[0] +
                                          "' --set 'decode.min_modulation_dn=" + trial.values[1] + "'");
  Study odd = study;
  odd.scene = "it's here/scene.yaml";
  EXPECT_THAT(command_of(odd, trial), testing::StartsWith("fringeslam run 'it'\\''s here/scene.yaml' --seed "));
  Study limited = study;
  limited.views = 8;
  EXPECT_THAT(command_of(limited, trial),
              HasSubstr(" --seed " + std::to_string(trial.world_seed) + " --views 8 --with "));
}

TEST(StudyFile, ErrorsAreReportedWithTheirLine) {
  struct Case {
    const char *what, *by;
    int line;
    const char* says;
  };
  const std::vector<Case> cases = {
      {"trials: 6", "trials: 0", 3, "'trials'"},
      {"seed: 5", "sed: 5", 4, "did you mean 'seed'"},
      {"scene: scene.yaml", "scene: nowhere", 2, "does not exist"},
      {"[10, 5000]", "[10, 1]", 7, "put the smaller number first"},
      {"[10, 5000]", "[0, 1]", 7, "above 0"},
      {"log_uniform", "logarithmic", 7, "needs uniform, log_uniform, normal, choice or grid"},
      {"light.ambient_lux", "light.ambiant_lux", 7, "did you mean 'ambient_lux'"},
      {"light.ambient_lux", "lihgt.ambient_lux", 7, "unknown key 'lihgt'; did you mean 'light'?"},
      {"objects.1.count: 6", "ambient_lux: 6", 10, "unknown key 'ambient_lux'"},
      {"objects.1.count: 6", "include: none.yaml", 10, "cannot be changed"},
      {"decode.min_modulation_dn", "decode.min_modulation", 8, "did you mean 'min_modulation_dn'"},
      {"[10, 5000]", "[1e7, 2e7]", 7, "'ambient_lux'"},
      {"objects.1.count: 6", "objects.7.count: 6", 10, "a list of 2"},
      {"objects.1.count: 6", "light.ambient_lux: 6", 10, "is also a parameter"},
      {"worlds: 2", "design: saltelli", 3, "rows of 4 trials"},
      {"max_rotation_deg", "max_rotation", 11, "did you mean 'max_rotation_deg'"}};
  for (const Case& c : cases) {
    const test::TempFolder temp;
    const auto file = test::write_study(temp.path(), replaced(test::kSmallStudy, c.what, c.by));
    const std::string message = error_of([&] { check_study(read_study(file)); });
    EXPECT_THAT(message, AllOf(HasSubstr(file.string() + ":" + std::to_string(c.line) + ": "), HasSubstr(c.says)))
        << c.by;
  }
}

}  // namespace
}  // namespace fringeslam::studies

// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <string>

#include "bench/studies/rows.h"
#include "bench/studies/study.h"
#include "bench/studies/summary.h"
#include "bench/studies/trial_run.h"

namespace fringeslam::studies {
namespace {

TEST(Wilson, IsTheKnownInterval) {
  // Computed by hand: centre (p + z^2/2n) / (1 + z^2/n), z^2 = 3.8415.
  EXPECT_NEAR(wilson(5, 10).low, 0.23659, 1e-5);
  EXPECT_NEAR(wilson(5, 10).high, 0.76341, 1e-5);
  EXPECT_EQ(wilson(0, 10).low, 0);
  EXPECT_NEAR(wilson(0, 10).high, 3.841459 / 13.841459, 1e-6);
  EXPECT_NEAR(wilson(10, 10).low, 1 - 3.841459 / 13.841459, 1e-6);
  EXPECT_EQ(wilson(10, 10).high, 1);
  EXPECT_EQ(wilson(0, 0).high, 1);
}

// Ishigami's function sin x + 7 sin^2 y + 0.1 z^4 sin x, with known indices.
TEST(Sobol, OfIshigamisFunctionAreTheKnownOnes) {
  Study study;
  study.design = Design::saltelli;
  for (const char* name : {"x", "y", "z"}) {
    Parameter parameter;
    parameter.name = name;
    parameter.a = -std::numbers::pi, parameter.b = std::numbers::pi;
    study.parameters.push_back(parameter);
  }
  constexpr int kRows = 4096;
  std::vector<std::vector<double>> output(5);
  for (int row = 0; row < kRows; ++row) {
    for (int k = 0; k < 5; ++k) {
      const Trial trial = trial_of(study, 5 * row + k);
      const double x = std::stod(trial.values[0]), y = std::stod(trial.values[1]), z = std::stod(trial.values[2]);
      output[static_cast<size_t>(k)].push_back(std::sin(x) + 7 * std::pow(std::sin(y), 2) +
                                               0.1 * std::pow(z, 4) * std::sin(x));
    }
  }
  const double first[] = {0.3139, 0.4424, 0}, total[] = {0.5576, 0.4424, 0.2437};
  for (size_t p = 0; p < 3; ++p) {
    const SobolIndex index = sobol(output[0], output[1], output[2 + p]);
    EXPECT_NEAR(index.first, first[p], 0.06) << p;
    EXPECT_NEAR(index.total, total[p], 0.04) << p;
    EXPECT_LT(index.first_95.low, index.first);
    EXPECT_GT(index.first_95.high, index.first);
    EXPECT_TRUE(index.total_95.low < total[p] && total[p] < index.total_95.high) << p;
  }
}

// 400 rows of a saltelli design, of which a trial succeeds if its first value is below a half.
class SaltelliStudy : public testing::Test {
 protected:
  SaltelliStudy() {
    study_.design = Design::saltelli;
    for (const char* name : {"a", "b"}) {
      Parameter parameter;
      parameter.name = name;
      parameter.b = 1;
      study_.parameters.push_back(parameter);
    }
    study_.trials = kRows * row_length(study_);
    for (int i = 0; i < study_.trials; ++i) {
      const Trial trial = trial_of(study_, i);
      TrialResult result;
      result.index = i;
      const double a = std::stod(trial.values[0]);
      result.outcome = a < 0.5 ? Outcome::success : Outcome::inaccurate;
      result.metrics = {{"translation_mm", a}, {"rotation_deg", 0}};
      lines_[i] = to_line(study_, trial, result);
    }
  }

  static constexpr int kRows = 400;
  Study study_;
  std::map<int, std::string> lines_;
};

TEST_F(SaltelliStudy, IntervalsCountIndependentTrials) {
  const Summary summary = summarise(study_, lines_);
  int successes = 0;
  for (const Row& row : rows_of(study_, lines_)) successes += row.success && row.trial % row_length(study_) < 2;
  const Interval expected = wilson(successes, 2 * kRows);
  EXPECT_EQ(summary.trials, 4 * kRows);
  EXPECT_EQ(summary.rate_95.low, expected.low);
  EXPECT_EQ(summary.rate_95.high, expected.high);
}

TEST_F(SaltelliStudy, AMissingTrialCostsItsRowOnly) {
  const double whole = summarise(study_, lines_).parameters[0].of_success.first;
  lines_.erase(5);
  const Summary summary = summarise(study_, lines_);
  EXPECT_EQ(summary.missing, 1);
  EXPECT_NEAR(summary.parameters[0].of_success.first, whole, 0.02);
  EXPECT_NEAR(whole, 1, 0.2);
}

TEST(FirstOrder, OfALinearFunctionIsItsShareOfTheVariance) {
  Study study;
  for (const char* name : {"a", "b", "c"}) {
    Parameter parameter;
    parameter.name = name;
    parameter.b = 1;
    study.parameters.push_back(parameter);
  }
  std::vector<std::vector<double>> in(3);
  std::vector<double> out;
  for (int i = 0; i < 3000; ++i) {
    const Trial trial = trial_of(study, i);
    for (size_t p = 0; p < 3; ++p) in[p].push_back(std::stod(trial.values[p]));
    out.push_back(3 * in[0].back() + in[1].back());
  }
  EXPECT_NEAR(first_order(in[0], out).first, 0.9, 0.02);
  EXPECT_NEAR(first_order(in[1], out).first, 0.1, 0.03);
  EXPECT_NEAR(first_order(in[2], out).first, 0, 0.01);  // the share due to chance is subtracted
  EXPECT_TRUE(std::isnan(first_order({1, 2, 3}, {1, 2, 3}).first));
  // Neither the interval of a parameter without influence nor that of one with influence is shifted.
  int above = 0, below = 0;
  for (size_t begin = 0; begin < 3000; begin += 100) {
    const auto part = [&](const std::vector<double>& of) {
      return std::vector<double>(of.begin() + static_cast<std::ptrdiff_t>(begin),
                                 of.begin() + static_cast<std::ptrdiff_t>(begin + 100));
    };
    const Interval none = first_order(part(in[2]), part(out)).first_95,
                   some = first_order(part(in[0]), part(out)).first_95;
    above += (none.low > 0) + (some.low > 0.9);
    below += (none.high < 0) + (some.high < 0.9);
  }
  EXPECT_LE(above, 8);  // of 60
  EXPECT_LE(below, 8);
  EXPECT_TRUE(std::isnan(first_order(in[0], std::vector<double>(3000, 1.0)).first));
}

}  // namespace
}  // namespace fringeslam::studies

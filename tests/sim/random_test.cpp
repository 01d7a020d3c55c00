// SPDX-License-Identifier: Apache-2.0
#include "sim/random.h"

#include <gtest/gtest.h>

#include <array>
#include <set>

namespace fringeslam::sim {
namespace {

// Known-answer vectors of Random123 for philox4x32 with 10 rounds (tests/kat_vectors).
struct KnownAnswer {
  std::array<uint32_t, 4> counter;
  std::array<uint32_t, 2> key;
  std::array<uint32_t, 4> answer;
};

const std::array<KnownAnswer, 3> kKnownAnswers = {{
    {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
    {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
     {0xffffffff, 0xffffffff},
     {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
    {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
     {0xa4093822, 0x299f31d0},
     {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
}};

// Number at the centre of the cell given by 53 bits of two words.
double unit_of(uint32_t high, uint32_t low) {
  return (static_cast<double>((uint64_t{high} << 32 | low) >> 11) + 0.5) * 0x1p-53;
}

Philox generator_of(const KnownAnswer& known) {
  const uint64_t seed = uint64_t{known.key[1]} << 32 | known.key[0];
  return {seed, static_cast<Stream>(known.counter[1]), known.counter[2], known.counter[3]};
}

TEST(Philox, GivesThePublishedAnswersAsNormalNumbers) {
  for (const KnownAnswer& known : kKnownAnswers) {
    const auto [first, second] = generator_of(known).normal_pair(known.counter[0]);
    const double radius = std::sqrt(-2 * std::log(unit_of(known.answer[0], known.answer[1])));
    const double angle = 2 * std::numbers::pi * unit_of(known.answer[2], known.answer[3]);
    EXPECT_DOUBLE_EQ(first, radius * std::cos(angle));
    EXPECT_DOUBLE_EQ(second, radius * std::sin(angle));
  }
}

TEST(Philox, GivesThePublishedAnswerAsAUniformNumber) {
  // A sequence starts at address 0, so only the vector with that counter applies.
  const KnownAnswer& known = kKnownAnswers[0];
  EXPECT_DOUBLE_EQ(generator_of(known).uniform(), unit_of(known.answer[0], known.answer[1]));
}

TEST(Philox, UniformNumbersHaveTheMomentsOfTheUnitInterval) {
  constexpr int kCount = 1000000;
  Philox random(42, Stream::placement, 3);
  double sum = 0, squares = 0, product = 0, last = 0.5;
  for (int i = 0; i < kCount; ++i) {
    const double u = random.uniform();
    ASSERT_GT(u, 0);
    ASSERT_LT(u, 1);
    sum += u, squares += u * u, product += (u - 0.5) * (last - 0.5);
    last = u;
  }
  // Bounds: five standard deviations of each mean.
  EXPECT_NEAR(sum / kCount, 0.5, 5 * std::sqrt(1.0 / 12 / kCount));
  EXPECT_NEAR(squares / kCount, 1.0 / 3, 5 * std::sqrt(4.0 / 45 / kCount));
  EXPECT_NEAR(product / kCount, 0, 5 * std::sqrt(1.0 / 144 / kCount));
}

TEST(Philox, UniformNumbersFillEveryBin) {
  constexpr int kBins = 64, kCount = 640000;
  std::array<int, kBins> bins{};
  Philox random(1, Stream::shape, 0);
  for (int i = 0; i < kCount; ++i) ++bins.at(static_cast<size_t>(random.uniform() * kBins));
  double chi2 = 0;
  constexpr double kExpected = static_cast<double>(kCount) / kBins;
  for (const int count : bins) chi2 += (count - kExpected) * (count - kExpected) / kExpected;
  EXPECT_LT(chi2, 63 + 5 * std::sqrt(2.0 * 63));
  EXPECT_GT(chi2, 63 - 5 * std::sqrt(2.0 * 63));  // too uniform would be wrong, too
}

TEST(Philox, NormalNumbersHaveTheMomentsOfTheNormalDistribution) {
  constexpr int kPairs = 500000;
  const Philox random(7, Stream::sensor_noise, 1, 2);
  double sum = 0, squares = 0, fourth = 0, product = 0;
  for (uint32_t i = 0; i < kPairs; ++i) {
    const auto [a, b] = random.normal_pair(i);
    for (const double x : {a, b}) sum += x, squares += x * x, fourth += x * x * x * x;
    product += a * b;
  }
  constexpr double kCount = 2.0 * kPairs;
  EXPECT_NEAR(sum / kCount, 0, 5 / std::sqrt(kCount));
  EXPECT_NEAR(squares / kCount, 1, 5 * std::sqrt(2 / kCount));
  EXPECT_NEAR(fourth / kCount, 3, 5 * std::sqrt(96 / kCount));
  EXPECT_NEAR(product / kPairs, 0, 5 / std::sqrt(static_cast<double>(kPairs)));
}

TEST(Philox, EveryPartOfTheAddressGivesOtherNumbers) {
  std::set<double> numbers;
  const uint64_t seed = 5;
  for (const uint64_t s : {seed, seed + 1, seed + (uint64_t{1} << 32)})
    numbers.insert(Philox(s, Stream::shape, 0).uniform());
  numbers.insert(Philox(seed, Stream::placement, 0).uniform());
  numbers.insert(Philox(seed, Stream::shape, 1).uniform());
  numbers.insert(Philox(seed, Stream::shape, 0, 1).uniform());
  EXPECT_EQ(numbers.size(), 6u);
}

TEST(Philox, UniformStaysWithinItsLimits) {
  Philox random(5, Stream::shape, 0);
  for (int i = 0; i < 10000; ++i) {
    const double x = random.uniform(-3, 5);
    ASSERT_GE(x, -3);
    ASSERT_LE(x, 5);
  }
}

}  // namespace
}  // namespace fringeslam::sim

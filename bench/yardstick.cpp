// SPDX-License-Identifier: Apache-2.0
#include "bench/yardstick.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "core/base/instruction_set.h"
#include "core/base/parallel.h"
#include "core/score/score.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam::bench {

namespace {

constexpr int kTasks = 32, kRepeats = 5;
constexpr size_t kCopied = size_t{1} << 20, kTable = size_t{1} << 22, kGathered = size_t{1} << 19;  // floats
constexpr int kProducts = 1 << 24;

// Times of the three parts on two idle cores of an AMD EPYC with AVX-512, for which the limits were set.
struct Times {
  double copy_s, products_s, gather_s;
};
constexpr Times kReference{9.7e-3, 13.3e-3, 35e-3};

FRINGESLAM_INLINE void multiply_add_body(int rounds, float* values) {
  constexpr int kWidth = 256;
  for (int k = 0; k < rounds / kWidth; ++k) {
#pragma GCC ivdep
    for (int i = 0; i < kWidth; ++i) values[i] = values[i] * 0.999f + 0.001f;
  }
}

template <class Body>
double fastest_s(const Body& body) {
  double least_s = std::numeric_limits<double>::infinity();
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    for_each_row(kTasks, body);
    least_s = std::min(least_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return least_s;
}

}  // namespace

double measure_yardstick() {
  static const auto multiply_add = Variants<multiply_add_body>::of(selected_instruction_set());
  std::vector<float> from(kTasks * kCopied, 1.0f), to(kTasks * kCopied), table(kTable, 1.0f);
  std::vector<uint32_t> index(kGathered);
  uint32_t state = 1;
  for (uint32_t& value : index) value = (state = 1664525 * state + 1013904223) >> 10;  // 22 bits: within the table
  std::array<float, kTasks> sums{};
  const double copy_s = fastest_s([&](int task) {
    const auto offset = static_cast<std::ptrdiff_t>(static_cast<size_t>(task) * kCopied);
    std::copy_n(from.begin() + offset, kCopied, to.begin() + offset);
  });
  const double products_s = fastest_s([&](int task) {
    std::array<float, 256> values{};
    multiply_add(kProducts, values.data());
    sums[static_cast<size_t>(task)] += values[0];
  });
  const double gather_s = fastest_s([&](int task) {
    float sum = 0;
    for (const uint32_t i : index) sum += table[i];
    sums[static_cast<size_t>(task)] += sum;
  });
  volatile float used = to[kCopied] + sums[0];
  static_cast<void>(used);
  return std::cbrt(copy_s / kReference.copy_s * products_s / kReference.products_s * gather_s / kReference.gather_s);
}

bool depends_on_machine(const Row& row) {
  constexpr std::array<std::string_view, 8> kUnits = {"ms",       "s",       "min",      "ms an image",
                                                      "frames/s", "views/s", "images/s", "Mrays/s"};
  return row.id.rfind("speed.", 0) == 0 && std::find(kUnits.begin(), kUnits.end(), row.unit) != kUnits.end();
}

void scale(Row& row, double yardstick) {
  const bool rate = row.direction == Limit::least;
  row.yardstick = yardstick;
  row.scaled = rate ? row.value * yardstick : row.value / yardstick;
  row.pass = rate ? row.scaled >= row.limit : row.scaled <= row.limit;
}

}  // namespace fringeslam::bench

// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/micro_code.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "core/base/constants.h"
#include "core/types/error.h"

namespace fringeslam {

int micro_orders(double period_px, int length_px) { return static_cast<int>(std::ceil(length_px / period_px)) + 1; }

namespace {

constexpr int kComparedPhases = 8;

// At the phase t turns, the images of orders K and K + m in period p_f differ by
//   cos(2 pi r (t + K)) - cos(2 pi r (t + K + m)) = 2 sin(2 pi r (t + K + m/2)) sin(pi r m),   r = p / p_f.
// Gives up as soon as the distance is known to be less than `enough`.
MicroCodeDistance code_distance(double period_px, const std::vector<double>& other_periods_px, int length_px,
                                double enough) {
  const int orders = micro_orders(period_px, length_px);
  const size_t images = other_periods_px.size();
  // sin^2 of all phases in steps of half an order.
  const int halves = 2 * orders * kComparedPhases;
  std::vector<std::vector<double>> squares(images, std::vector<double>(static_cast<size_t>(halves)));
  for (size_t f = 0; f < images; ++f) {
    for (int i = 0; i < halves; ++i) {
      const double sine = std::sin(kTwoPi * period_px / other_periods_px[f] * i / (2.0 * kComparedPhases));
      squares[f][static_cast<size_t>(i)] = sine * sine;
    }
  }
  MicroCodeDistance least{std::numeric_limits<double>::max(), 0};
  std::vector<double> factor(images);
  for (int apart = 1; apart < orders; ++apart) {
    for (size_t f = 0; f < images; ++f) {
      const double sine = std::sin(kPi * period_px / other_periods_px[f] * apart);
      factor[f] = 4 * sine * sine;
    }
    // Twice the phase between the two orders, in steps of 1 / kComparedPhases.
    for (int i = apart * kComparedPhases; i < halves - apart * kComparedPhases; ++i) {
      double sum = 0;
      for (size_t f = 0; f < images; ++f) sum += factor[f] * squares[f][static_cast<size_t>(i)];
      if (sum < least.distance) least = {sum, apart};
    }
    if (least.distance < enough * enough) break;
  }
  least.distance = std::sqrt(least.distance);
  return least;
}

}  // namespace

MicroCodeDistance micro_code_distance(double period_px, const std::vector<double>& other_periods_px, int length_px) {
  return code_distance(period_px, other_periods_px, length_px, 0);
}

std::vector<double> micro_periods(double period_px, int count, int length_px) {
  constexpr double kBand = 0.1, kLeastDistance = 0.05, kGrid_px = 1e-3;
  constexpr int kMostTrials = 4000, kFewestTrials = 100;
  constexpr double kMostTerms = 2e10;
  const auto refuse = [&] {
    throw Error("patterns: no " + std::to_string(count) + " further periods distinguish the fringes of " +
                std::to_string(std::lround(period_px)) + " px over " + std::to_string(length_px) +
                " px; use more images or a longer period");
  };
  // Beyond this number, trials take minutes and noise hides the code.
  constexpr int kMostOrders = 1000;
  if (!(length_px < kMostOrders * period_px)) refuse();
  std::mt19937_64 random(1);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) / 9007199254740992.0; };
  std::vector<double> best;
  double distance = 0;
  const double orders = micro_orders(period_px, length_px), terms = count * kComparedPhases * orders * orders;
  const int trials = static_cast<int>(std::clamp<double>(kMostTerms / terms, kFewestTrials, kMostTrials));
  for (int trial = 0; trial < trials; ++trial) {
    std::vector<double> periods;
    for (int i = 0; i < count; ++i)
      periods.push_back(kGrid_px * std::round(period_px * (1 + kBand * (2 * uniform() - 1)) / kGrid_px));
    const double here = code_distance(period_px, periods, length_px, std::max(distance, kLeastDistance)).distance;
    if (here <= distance) continue;
    distance = here;
    best = periods;
  }
  if (distance < kLeastDistance) refuse();
  std::sort(best.begin(), best.end());
  return best;
}

}  // namespace fringeslam

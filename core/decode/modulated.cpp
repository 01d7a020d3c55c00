// SPDX-License-Identifier: Apache-2.0
#include "core/decode/modulated.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "core/base/constants.h"
#include "core/decode/steps.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

struct Product {
  double period_px = 0, carrier_px = 0;
  FringeGroup sum, difference;  // the fringes with the frequencies 1/c + 1/p and 1/c - 1/p
};

std::string name_of(const Product& product) {
  return "the products with periods of " + to_text(product.period_px) + " and " + to_text(product.carrier_px) + " px";
}

std::vector<Product> products_of(const PatternSequence& sequence, Axis axis) {
  std::vector<Product> products;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::product || pattern.axis != axis) continue;
    const double p = pattern.period_px, c = pattern.carrier_px;
    auto product = std::find_if(products.begin(), products.end(),
                                [&](const Product& known) { return known.period_px == p && known.carrier_px == c; });
    if (product == products.end())
      product = products.insert(products.end(),
                                {p, c, {axis, 1 / (1 / c + 1 / p), {}, {}}, {axis, 1 / (1 / c - 1 / p), {}, {}}});
    product->sum.images.push_back(static_cast<int>(i));
    product->sum.shifts_rad.push_back(pattern.carrier_shift_rad + pattern.shift_rad);
    product->difference.images.push_back(static_cast<int>(i));
    product->difference.shifts_rad.push_back(pattern.carrier_shift_rad - pattern.shift_rad);
  }
  std::stable_sort(products.begin(), products.end(),
                   [](const Product& a, const Product& b) { return a.period_px > b.period_px; });
  return products;
}

// The least squares of one fringe ignore the other one, which is correct if both are orthogonal to each other and to the
// mean, as in all combinations of equally spaced shifts.
bool separates(const Product& product) {
  using Phasor = std::complex<double>;
  const auto phasor = [](double angle_rad) { return std::polar(1.0, angle_rad); };
  Phasor mean_sum, mean_difference, square_sum, square_difference, cross, conjugate_cross;
  for (size_t k = 0; k < product.sum.images.size(); ++k) {
    const Phasor a = phasor(product.sum.shifts_rad[k]), b = phasor(product.difference.shifts_rad[k]);
    mean_sum += a, mean_difference += b;
    square_sum += a * a, square_difference += b * b;
    cross += a * b, conjugate_cross += a * std::conj(b);
  }
  const double tolerance = 1e-6 * static_cast<double>(product.sum.images.size());
  const Phasor sums[] = {mean_sum, mean_difference, square_sum, square_difference, cross, conjugate_cross};
  return std::all_of(std::begin(sums), std::end(sums), [&](const Phasor& sum) { return std::abs(sum) <= tolerance; });
}

// The phase of group `finer` minus that of `coarser`.
UnwrappingLevel difference_level(const std::vector<FringeGroup>& groups, size_t finer, size_t coarser) {
  UnwrappingLevel level{1 / (1 / groups[finer].period_px - 1 / groups[coarser].period_px),
                        std::vector<int>(groups.size(), 0)};
  level.multiples[finer] = 1;
  level.multiples[coarser] = -1;
  return level;
}

}  // namespace

ModulatedCode modulated_code(const PatternSequence& sequence, Axis axis, int length_px) {
  const std::vector<Product> products = products_of(sequence, axis);
  if (products.empty()) throw Error("the sequence has no products of cosines; add `modulated_period_px`");
  for (const Product& product : products) {
    if (product.carrier_px != products.front().carrier_px)
      throw Error("the products have carriers of " + to_text(products.front().carrier_px) + " and " +
                  to_text(product.carrier_px) + " px; use one");
  }
  ModulatedCode code;
  for (const Product& product : products) {
    if (product.period_px <= 2 * product.carrier_px)
      throw Error(name_of(product) + " have no high-frequency carrier; it must be shorter than half the period");
    if (!separates(product))
      throw Error("the shifts of " + name_of(product) +
                  " do not separate their two fringes; use all combinations of at least three equally spaced shifts "
                  "of each");
    code.groups.push_back(product.difference);
    code.groups.push_back(product.sum);
  }
  const double carrier_px = products.front().carrier_px, longest_px = products.front().period_px;
  const std::vector<FringeGroup> fringes = fringe_groups(sequence, axis);
  const auto carrier = std::find_if(fringes.begin(), fringes.end(),
                                    [&](const FringeGroup& group) { return group.period_px == carrier_px; });
  const bool has_carrier = carrier != fringes.end();
  if (has_carrier) code.groups.push_back(*carrier);
  if (code.groups.size() > kMaxGroups)
    throw Error(std::to_string(products.size()) + " products have " + std::to_string(code.groups.size()) +
                " fringes, more than " + std::to_string(kMaxGroups) + "; use fewer products");
  for (const FringeGroup& group : code.groups) {
    if (group.images.size() > kMaxSteps)
      throw Error("more than " + std::to_string(kMaxSteps) + " images of one product; use fewer steps");
  }
  const size_t last = code.groups.size() - 1;
  if (longest_px < (has_carrier ? 1 : 2) * length_px)
    throw Error("no product covers the projector's " + std::to_string(length_px) + " px (the longest period is " +
                to_text(longest_px) + " px" +
                (has_carrier ? ")" : ", of which half is unique without fringes of the carrier's period)") +
                "; add one that does");
  if (longest_px < 2 * length_px) code.levels.push_back(difference_level(code.groups, 1, last));
  for (size_t sum = 1; sum < 2 * products.size(); sum += 2)
    code.levels.push_back(difference_level(code.groups, sum, sum - 1));
  UnwrappingLevel finest{code.groups[last].period_px, std::vector<int>(code.groups.size(), 0)};
  finest.multiples[last] = 1;
  code.levels.push_back(finest);
  return code;
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/decode/gray.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/decode/steps.h"
#include "core/patterns/long_run_code.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

float gray_value_variance(const RowPlan& camera, float grey) {
  return camera.noise_constant + camera.noise_per_dn * std::max(grey - camera.offset_dn, 0.0f);
}

namespace {

int flat_image(const PatternSequence& sequence, double level) {
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding == Coding::flat && pattern.level == level) return static_cast<int>(i);
  }
  return -1;
}

}  // namespace

GrayDecoder::GrayDecoder(const PatternSequence& sequence, Axis axis, const StepEstimator* fringes)
    : bits_(gray_bits(sequence, axis)),
      fringes_(fringes),
      white_(flat_image(sequence, 1)),
      black_(flat_image(sequence, 0)) {
  const int length = length_of(sequence, axis);
  if (bits_.empty()) throw Error("the sequence has no Gray code for this axis; add `gray: complementary`");
  if (bits_.front().code_bits > 0)
    check_long_runs(length);
  else
    check_cells(length);
  for (const GrayBit& bit : bits_) {
    const bool comparable = (bit.image >= 0 && bit.inverted_image >= 0) || fringes_ || (white_ >= 0 && black_ >= 0);
    if (!comparable)
      throw Error("the Gray code has no threshold for its bits; add fringes, inverted bits, or white and black images");
  }
}

void GrayDecoder::check_long_runs(int length) {
  const GrayBit& first = bits_.front();
  if (std::exp2(first.code_bits) * first.cell_px < length * (1 - 1e-9))
    throw Error("the Gray code distinguishes only " + to_text(std::exp2(first.code_bits) * first.cell_px) +
                " px of the projector's " + std::to_string(length) + " px; use one of more bits");
  for (int bit = 0; bit < first.code_bits; ++bit) {
    const auto i = static_cast<size_t>(bit);
    if (i >= bits_.size() || bits_[i].code_bit != bit)
      throw Error("the Gray code has no bit " + std::to_string(bit) + " of " + std::to_string(first.code_bits) +
                  " (code_bit); add it");
    carrier_.push_back(i);
  }
  const std::vector<unsigned>& words = long_run_code(first.code_bits);
  cells_.resize(words.size());
  for (size_t cell = 0; cell < words.size(); ++cell) cells_[words[cell]] = static_cast<int>(cell);
}

void GrayDecoder::check_cells(int length) {
  if (2 * bits_.front().cell_px < length * (1 - 1e-9))
    throw Error("the Gray code distinguishes only " + to_text(2 * bits_.front().cell_px) + " px of the projector's " +
                std::to_string(length) + " px; add coarser bits");
  if (bits_.size() > 31) throw Error("the Gray code has more than 31 bits");
  for (size_t i = 0; i < bits_.size(); ++i) {
    const GrayBit& bit = bits_[i];
    if (i > 0 && std::abs(bits_[i - 1].cell_px / bit.cell_px - 2) > 1e-6)
      throw Error("the Gray code has no bit between cells of " + to_text(bits_[i - 1].cell_px) + " and " +
                  to_text(bit.cell_px) + " px; each bit's cells must be half as wide as the previous bit's");
    const auto carrier =
        std::find_if(bits_.begin(), bits_.end(), [&](const GrayBit& other) { return other.cell_px == bit.carrier_px; });
    carrier_.push_back(bit.carrier_px > 0 ? static_cast<size_t>(carrier - bits_.begin()) : i);
    if (bit.carrier_px > 0 && (carrier == bits_.end() || carrier->carrier_px > 0))
      throw Error("the Gray bit with cells of " + to_text(bit.cell_px) + " px is combined with one of " +
                  to_text(bit.carrier_px) + " px, which the sequence does not contain by itself; add it");
  }
}

int GrayDecoder::cell_of(unsigned code) const {
  if (!cells_.empty()) return cells_[code];
  for (unsigned shift = 1; shift < 32; shift *= 2) code ^= code >> shift;
  return static_cast<int>(code);
}

GrayDecoder::Comparison GrayDecoder::compare(const RowPlan& camera, const float* const* samples, int col,
                                             const GrayBit& bit) const {
  const auto grey = [&](int image) { return samples[image][col]; };
  if (bit.image >= 0 && bit.inverted_image >= 0) {
    const float a = grey(bit.image), b = grey(bit.inverted_image);
    return {a - b, gray_value_variance(camera, a) + gray_value_variance(camera, b)};
  }
  float threshold = 0, variance = 0;
  if (fringes_) {
    for (size_t k = 0; k < fringes_->images.size(); ++k) {
      const float sample = grey(fringes_->images[k]), weight = fringes_->mean[k];
      threshold += weight * sample;
      variance += weight * weight * gray_value_variance(camera, sample);
    }
  } else {
    threshold = 0.5f * (grey(white_) + grey(black_));
    variance = 0.25f * (gray_value_variance(camera, grey(white_)) + gray_value_variance(camera, grey(black_)));
  }
  const float sample = grey(bit.image >= 0 ? bit.image : bit.inverted_image);
  const float sign = bit.image >= 0 ? 1.0f : -1.0f;
  return {sign * (sample - threshold), variance + gray_value_variance(camera, sample)};
}

// Exclusive or of two bits, as certain as the less certain one. The edges of both coincide, where both are faint; at
// pixels that see two surfaces only one of them may be.
GrayDecoder::Comparison GrayDecoder::combined(const Comparison& one, const Comparison& other) {
  const bool one_is_fainter =
      one.difference * one.difference * other.variance < other.difference * other.difference * one.variance;
  Comparison result = one_is_fainter ? one : other;
  const float faint = std::abs(result.difference);
  result.difference = (one.difference > 0) != (other.difference > 0) ? faint : -faint;
  const float high = std::max(std::abs(one.difference), std::abs(other.difference)),
              low = std::min(std::abs(one.difference), std::abs(other.difference));
  result.relative_contrast = high > 0 ? low / high : 0;
  return result;
}

GrayDecoder::Reading GrayDecoder::read(const RowPlan& camera, const float* const* samples, int col,
                                       float least_contrast_dn) const {
  constexpr size_t kMaxBits = 32;
  unsigned code = 0;
  std::array<Comparison, kMaxBits> bits;
  Reading reading;
  for (size_t i = 0; i < bits_.size(); ++i) {
    bits[i] = compare(camera, samples, col, bits_[i]);
    reading.best_contrast_dn = std::max(reading.best_contrast_dn, std::abs(bits[i].difference));
  }
  if (reading.best_contrast_dn < least_contrast_dn) {
    reading.far = 1;
    return reading;
  }
  for (size_t i = 0; i < bits_.size(); ++i) {
    if (carrier_[i] != i) bits[i] = combined(bits[i], bits[carrier_[i]]);
    code = code << 1 | (bits[i].difference > 0 ? 1U : 0U);
  }
  reading.cell = cell_of(code);
  float faintest = std::numeric_limits<float>::max(), next = faintest;
  size_t which = 0;
  for (size_t i = 0; i < bits_.size(); ++i) {
    const float contrast =
        carrier_[i] != i ? bits[i].relative_contrast * reading.best_contrast_dn : std::abs(bits[i].difference);
    if (contrast < faintest) {
      next = std::exchange(faintest, contrast);
      which = i;
    } else {
      next = std::min(next, contrast);
    }
    // Probability that noise flipped the bit; negligible beyond six sigmas.
    const auto sigmas =
        static_cast<double>(std::abs(bits[i].difference)) / std::sqrt(static_cast<double>(bits[i].variance));
    if (sigmas > 6) continue;
    const double wrong = 0.5 * std::erfc(sigmas / std::numbers::sqrt2);
    if (!is_neighbour(code, i)) {
      reading.far += wrong;
      continue;
    }
    reading.neighbour += wrong;
    // At the edge between two cells, where the bit that differs has little contrast, the error is half a cell with either
    // value: a flip changes its square by twice the distance from the edge.
    const int off = cells_off(code, i);
    const double squared =
        off > 1 ? off * off : std::min(1.0, static_cast<double>(contrast / reading.best_contrast_dn));
    reading.variance_cells2 += wrong * squared;
  }
  reading.contrast_dn = is_neighbour(code, which) ? next : faintest;
  return reading;
}

int GrayDecoder::cells_off(unsigned code, size_t bit) const {
  return std::abs(cell_of(code ^ 1U << (bits_.size() - 1 - bit)) - cell_of(code));
}

bool GrayDecoder::is_neighbour(unsigned code, size_t bit) const {
  constexpr int kFew = 4;
  return cells_off(code, bit) <= (fringes_ ? 1 : kFew);
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Vectorised normal numbers: Philox 4x32-10 and the Box-Muller transform on several counter blocks in parallel.
#include "sim/random.h"

#include <algorithm>
#include <bit>

#include "core/types/selected_instruction_set.h"

namespace fringeslam::sim {

namespace {

constexpr int kBlocks = 16;            // Philox blocks per call
constexpr int kNumbers = 4 * kBlocks;  // normal numbers per call

// -2 ln(u) for u = (floor(bits / 2^9) + 1/2) / 2^23, to about 1e-7: exponent plus a series for the log of the mantissa.
FRINGESLAM_INLINE float minus_two_log(uint32_t bits) {
  // Keep 23 bits: with 24, the largest numbers would round to u = 1.
  const float u = (static_cast<float>(static_cast<int32_t>(bits >> 9)) + 0.5f) * (1.0f / 8388608.0f);
  const auto raw = std::bit_cast<int32_t>(u);
  // Mantissa in [sqrt(1/2), sqrt(2)).
  const int32_t exponent = (raw - 0x3f3504f3) >> 23;
  const float m = std::bit_cast<float>(raw - (exponent << 23));
  const float s = (m - 1) / (m + 1), s2 = s * s;
  const float log_m = 2 * s * (1 + s2 * (1.0f / 3 + s2 * (1.0f / 5 + s2 * (1.0f / 7 + s2 * (1.0f / 9)))));
  return -2 * (log_m + 0.69314718f * static_cast<float>(exponent));
}

// Sine and cosine of bits / 2^32 turns.
FRINGESLAM_INLINE void turn(uint32_t bits, float& sine, float& cosine) {
  // Nearest quarter turn, and the remainder x within an eighth of a turn, rad.
  const uint32_t quarter = (bits + 0x20000000u) >> 30;
  const float x = static_cast<float>(static_cast<int32_t>(bits - (quarter << 30))) * (6.2831853f / 4294967296.0f);
  const float x2 = x * x;
  const float s = x * (1 - x2 * (1.0f / 6 - x2 * (1.0f / 120 - x2 * (1.0f / 5040))));
  const float c = 1 - x2 * (0.5f - x2 * (1.0f / 24 - x2 * (1.0f / 720 - x2 * (1.0f / 40320))));
  const bool swapped = quarter & 1;
  const float a = swapped ? c : s, b = swapped ? s : c;
  sine = (quarter & 2) ? -a : a;
  cosine = ((quarter + 1) & 2) ? -b : b;
}

FRINGESLAM_INLINE void normals(const uint32_t* key, const uint32_t* counter, uint32_t first, float* out) {
  alignas(64) uint32_t a[kBlocks], b[kBlocks], c[kBlocks], d[kBlocks];
  for (int i = 0; i < kBlocks; ++i) {
    a[i] = first + static_cast<uint32_t>(i);
    b[i] = counter[0];
    c[i] = counter[1];
    d[i] = counter[2];
  }
  uint32_t k0 = key[0], k1 = key[1];
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < kBlocks; ++i) {
      const uint64_t p = 0xD2511F53ull * a[i], q = 0xCD9E8D57ull * c[i];
      const uint32_t na = static_cast<uint32_t>(q >> 32) ^ b[i] ^ k0, nc = static_cast<uint32_t>(p >> 32) ^ d[i] ^ k1;
      b[i] = static_cast<uint32_t>(q);
      d[i] = static_cast<uint32_t>(p);
      a[i] = na;
      c[i] = nc;
    }
    k0 += 0x9E3779B9u;
    k1 += 0xBB67AE85u;
  }
  for (int i = 0; i < kBlocks; ++i) {
    float sine, cosine;
    const float radius = std::sqrt(minus_two_log(a[i]));
    turn(b[i], sine, cosine);
    out[i] = radius * cosine;
    out[kBlocks + i] = radius * sine;
    const float other = std::sqrt(minus_two_log(c[i]));
    turn(d[i], sine, cosine);
    out[2 * kBlocks + i] = other * cosine;
    out[3 * kBlocks + i] = other * sine;
  }
}

}  // namespace

NormalField::NormalField(uint64_t seed, Stream stream, uint32_t a, uint32_t b)
    : key_{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)},
      counter_{static_cast<uint32_t>(stream), a, b} {}

void NormalField::row(uint32_t row, std::span<float> values) const {
  static const auto kernel = Variants<normals>::of(selected_instruction_set());
  // Rows of up to 2^16 blocks do not share numbers.
  uint32_t block = row << 16;
  alignas(64) float numbers[kNumbers];
  for (size_t first = 0; first < values.size(); first += kNumbers, block += kBlocks) {
    kernel(key_, counter_, block, numbers);
    std::copy_n(numbers, std::min<size_t>(kNumbers, values.size() - first),
                values.begin() + static_cast<std::ptrdiff_t>(first));
  }
}

}  // namespace fringeslam::sim

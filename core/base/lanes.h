// SPDX-License-Identifier: Apache-2.0
// SIMD vectors of floats for kernels that compilers do not vectorize on their own. Compilers split comparisons of these
// vector types into scalar code, so masks are built from sign bits.
#pragma once

#include <cstdint>
#include <cstring>

#include "core/base/instruction_set.h"

// The vectors are only passed between inlined functions, so the ABI warning does not apply.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace fringeslam {

template <int lanes>
struct Lanes {
  typedef float Floats __attribute__((vector_size(4 * lanes)));
  typedef int32_t Mask __attribute__((vector_size(4 * lanes)));  // -1 or 0
  typedef uint32_t Bits __attribute__((vector_size(4 * lanes)));

  FRINGESLAM_INLINE static Floats load(const float* from) {
    Floats v;
    std::memcpy(&v, from, sizeof v);
    return v;
  }
  FRINGESLAM_INLINE static Mask load(const int32_t* from) {
    Mask v;
    std::memcpy(&v, from, sizeof v);
    return v;
  }
  FRINGESLAM_INLINE static void store(Floats v, float* to) { std::memcpy(to, &v, sizeof v); }
  FRINGESLAM_INLINE static void store(Mask v, int32_t* to) { std::memcpy(to, &v, sizeof v); }

  template <class Ints>
  FRINGESLAM_INLINE static bool any(Ints mask) {
    if constexpr (lanes == 16) {
      return Lanes<8>::any(__builtin_shufflevector(mask, mask, 0, 1, 2, 3, 4, 5, 6, 7) |
                           __builtin_shufflevector(mask, mask, 8, 9, 10, 11, 12, 13, 14, 15));
    } else if constexpr (lanes == 8) {
      return Lanes<4>::any(__builtin_shufflevector(mask, mask, 0, 1, 2, 3) |
                           __builtin_shufflevector(mask, mask, 4, 5, 6, 7));
    } else {
      int64_t pairs[2];
      static_assert(lanes == 4);
      std::memcpy(pairs, &mask, sizeof pairs);
      return (pairs[0] | pairs[1]) != 0;
    }
  }

  FRINGESLAM_INLINE static Floats masked(Floats v, Mask mask) { return Floats(Mask(v) & mask); }
  FRINGESLAM_INLINE static Floats chosen(Mask mask, Floats yes, Floats no) {
    return Floats((Mask(yes) & mask) | (Mask(no) & ~mask));
  }
  // Tests the sign bit: true for -0, and for NaN with the sign bit set.
  FRINGESLAM_INLINE static Mask negative(Floats v) { return Mask(v) >> 31; }
  FRINGESLAM_INLINE static Mask not_negative(Floats v) { return ~negative(v); }
  FRINGESLAM_INLINE static Floats absolute(Floats v) { return Floats(Mask(v) & 0x7fffffff); }
  FRINGESLAM_INLINE static Floats least(Floats a, Floats b) { return chosen(negative(a - b), a, b); }
};

}  // namespace fringeslam

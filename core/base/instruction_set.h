// SPDX-License-Identifier: Apache-2.0
// Runtime dispatch by instruction set: hot loops are compiled from one source for several instruction sets, and the
// variant for the widest one that the CPU supports is selected at run time. Floating-point contraction is disabled in
// these files, so all variants give bit-identical results.
#pragma once

#define FRINGESLAM_INLINE inline __attribute__((always_inline))
#if defined(__x86_64__)
#define FRINGESLAM_AVX2 __attribute__((target("avx2,popcnt")))
#define FRINGESLAM_AVX512 __attribute__((target("avx512f,avx512dq,avx512vl,avx512bw,popcnt")))
#else
#define FRINGESLAM_AVX2
#define FRINGESLAM_AVX512
#endif

namespace fringeslam {

enum class InstructionSet { portable, avx2, avx512 };

inline InstructionSet widest_instruction_set() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw"))
    return InstructionSet::avx512;
  if (__builtin_cpu_supports("avx2")) return InstructionSet::avx2;
#endif
  return InstructionSet::portable;
}

// A kernel's variants: one body, or one per instruction set, compiled for each of them. Bodies are FRINGESLAM_INLINE,
// because only inlined code is compiled for the variant's instruction set.
template <auto portable_body, auto avx2_body = portable_body, auto avx512_body = avx2_body>
struct Variants;

template <class Result, class... Args, Result (*portable_body)(Args...), Result (*avx2_body)(Args...),
          Result (*avx512_body)(Args...)>
struct Variants<portable_body, avx2_body, avx512_body> {
  static Result portable(Args... args) { return portable_body(args...); }
  FRINGESLAM_AVX2 static Result avx2(Args... args) { return avx2_body(args...); }
  FRINGESLAM_AVX512 static Result avx512(Args... args) { return avx512_body(args...); }

  static auto of([[maybe_unused]] InstructionSet set) -> Result (*)(Args...) {
#if defined(__x86_64__)
    if (set == InstructionSet::avx512) return avx512;
    if (set == InstructionSet::avx2) return avx2;
#endif
    return portable;
  }
};

}  // namespace fringeslam

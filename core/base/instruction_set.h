// SPDX-License-Identifier: Apache-2.0
// Runtime dispatch by instruction set: hot loops are compiled from one source for several instruction sets, and the
// widest one that the CPU supports is selected at run time. Floating-point contraction is disabled in these files, so
// all variants give bit-identical results.
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

// Returns the variant of a function for the widest supported instruction set.
template <class Function>
Function* widest(Function* portable, Function* avx2, Function* avx512) {
  switch (widest_instruction_set()) {
    case InstructionSet::avx512:
      return avx512;
    case InstructionSet::avx2:
      return avx2;
    default:
      return portable;
  }
}

}  // namespace fringeslam

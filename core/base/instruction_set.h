// SPDX-License-Identifier: Apache-2.0
// Hot loops are compiled from one source for several instruction sets, and the machine's widest is taken at run time.
// Contraction of products and sums is off in their files, so all give the same bits.
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

// Of one function compiled for each of them the one to call.
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

// Pairs of bfloat16 numbers, as many as a register has floats, and their products summed in float32. Two neighbours in
// the direction of a sum share 32 bits, the first of them in the lower half. Where the processor has no instructions
// for them, those of float32 do the same but for the last bits of a sum, and take longer.
#pragma once

#include "field/vector.hpp"

#if defined(__AVX512BF16__)
#include <immintrin.h>
#endif

namespace aa4d::field::AA4D_ARCH {

using Bits = std::uint32_t __attribute__((vector_size(kWidth * 4)));
using Halves = std::uint16_t __attribute__((vector_size(kWidth * 2)));

inline Bits load(const std::uint32_t* p) {
  Bits v;
  __builtin_memcpy(&v, p, sizeof v);
  return v;
}
inline void store(std::uint32_t* p, Bits v) { __builtin_memcpy(p, &v, sizeof v); }

inline Vector low(Bits pairs) { return reinterpret_cast<Vector>(pairs << 16); }
inline Vector high(Bits pairs) { return reinterpret_cast<Vector>(pairs & 0xffff0000u); }

#if defined(__AVX512BF16__)

inline Vector multiply_add(Vector sum, std::uint32_t left, Bits right) {
  return reinterpret_cast<Vector>(_mm512_dpbf16_ps(
      reinterpret_cast<__m512>(sum), reinterpret_cast<__m512bh>(_mm512_set1_epi32(static_cast<int>(left))),
      reinterpret_cast<__m512bh>(right)));
}

// The numbers of two rows, side by side.
inline Bits interleave(Vector first, Vector second) {
  const __m512i both =
      reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(reinterpret_cast<__m512>(second), reinterpret_cast<__m512>(first)));
  const __m512i order = _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6, 21,
                                         5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
  return reinterpret_cast<Bits>(_mm512_permutexvar_epi16(order, both));
}

// The numbers of a row, neighbours in pairs: half a register.
inline void store_row(std::uint32_t* p, Vector row) {
  const __m256bh halves = _mm512_cvtneps_pbh(reinterpret_cast<__m512>(row));
  __builtin_memcpy(p, &halves, sizeof halves);
}

#else

// To the nearest, ties to even; NaN stays NaN.
inline Bits round_bits(Vector v) {
  const Bits bits = reinterpret_cast<Bits>(v);
  const Bits nearest = bits + 0x7fffu + ((bits >> 16) & 1u);
  return v == v ? nearest : bits | 0x00400000u;
}

inline Vector multiply_add(Vector sum, std::uint32_t left, Bits right) {
  const Bits pair = left - Bits{};
  sum += high(pair) * high(right);
  return sum + low(pair) * low(right);
}

inline Bits interleave(Vector first, Vector second) {
  return (round_bits(first) >> 16) | (round_bits(second) & 0xffff0000u);
}

inline void store_row(std::uint32_t* p, Vector row) {
  const Halves halves = __builtin_convertvector(round_bits(row) >> 16, Halves);
  __builtin_memcpy(p, &halves, sizeof halves);
}

#endif

}  // namespace aa4d::field::AA4D_ARCH

// Doubles for the projection, several Gaussians at a time: the vector types of GCC and Clang, as wide as the
// instruction set's registers. Included by kernels_*.cpp alone, like simd.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "raster/simd.hpp"

namespace aa4d::raster::AA4D_ARCH {

inline constexpr int kLanes = Float::kWidth / 2;
using Doubles = double __attribute__((vector_size(kLanes * 8)));
using Longs = std::int64_t __attribute__((vector_size(kLanes * 8)));  // a comparison gives -1 where it is true

inline Doubles splat(double value) { return value - Doubles{}; }
inline Doubles select(Longs mask, Doubles a, Doubles b) { return mask ? a : b; }
inline Doubles larger(Doubles a, Doubles b) { return a > b ? a : b; }
inline Doubles smaller(Doubles a, Doubles b) { return a < b ? a : b; }
inline Doubles limit(Doubles value, double low, double high) { return smaller(larger(value, splat(low)), splat(high)); }

inline Doubles square_root(Doubles a) {
#if defined(__AVX512F__)
  return _mm512_sqrt_pd(a);
#elif defined(__AVX2__)
  return _mm256_sqrt_pd(a);
#else
  for (int i = 0; i < kLanes; ++i) a[i] = __builtin_sqrt(a[i]);
  return a;
#endif
}

// Of values within the range of an int.
inline Doubles round_down(Doubles a) {
#if defined(__AVX512F__)
  return _mm512_floor_pd(a);
#elif defined(__AVX2__)
  return _mm256_floor_pd(a);
#else
  const Doubles truncated = __builtin_convertvector(__builtin_convertvector(a, Longs), Doubles);
  return truncated > a ? truncated - 1 : truncated;
#endif
}

// log2 of a positive, normal number: the exponent, and the series of atanh for the mantissa in [sqrt(1/2), sqrt(2)).
// Absolute error below 1e-11.
inline Doubles log2_positive(Doubles a) {
  constexpr std::int64_t kSqrtHalf = 0x3fe6a09e667f3bcd;
  Longs bits = reinterpret_cast<Longs>(a);
  const Longs exponent = (bits - kSqrtHalf) >> 52;
  const Doubles mantissa = reinterpret_cast<Doubles>(bits - (exponent << 52));
  const Doubles s = (mantissa - 1) / (mantissa + 1), s2 = s * s;
  const Doubles series =
      1 + s2 * (1.0 / 3 + s2 * (1.0 / 5 + s2 * (1.0 / 7 + s2 * (1.0 / 9 + s2 * (1.0 / 11 + s2 / 13)))));
  return __builtin_convertvector(exponent, Doubles) + 2.8853900817779268 * s * series;  // 2 / ln 2
}

// One column of a row-major [N, stride] array of floats for the Gaussians [begin, begin + kLanes); what would lie past
// `last` is read from there.
inline Doubles load_column(const float* values, int stride, int column, std::size_t begin, std::size_t last) {
  Doubles result;
  for (int i = 0; i < kLanes; ++i) {
    const std::size_t g = begin + i < last ? begin + i : last;
    result[i] = values[g * stride + column];
  }
  return result;
}

}  // namespace aa4d::raster::AA4D_ARCH

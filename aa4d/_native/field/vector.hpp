// Vectors as wide as the registers of the instruction set that the including file is compiled for, in the vector types
// of GCC and Clang. Only kernels_*.cpp include this file and the kernels built on it, and those keep to raw pointers:
// an inline function of the standard library compiled for AVX-512 could be the copy that the linker keeps for everyone.
#pragma once

#include <cstdint>

#if defined(__AVX512BF16__)
#define AA4D_ARCH avx512bf16
#define AA4D_WIDTH 16
#elif defined(__AVX512F__)
#define AA4D_ARCH avx512
#define AA4D_WIDTH 16
#elif defined(__AVX2__)
#define AA4D_ARCH avx2
#define AA4D_WIDTH 8
#else
#define AA4D_ARCH portable
#define AA4D_WIDTH 4
#endif

namespace aa4d::field::AA4D_ARCH {

inline constexpr int kWidth = AA4D_WIDTH;
using Vector = float __attribute__((vector_size(kWidth * 4)));
using Integers = std::int32_t __attribute__((vector_size(kWidth * 4)));

inline Vector splat(float value) { return value - Vector{}; }
inline Vector larger(Vector a, Vector b) { return a > b ? a : b; }

inline Vector load(const float* p) {
  Vector v;
  __builtin_memcpy(&v, p, sizeof v);
  return v;
}
inline void store(float* p, Vector v) { __builtin_memcpy(p, &v, sizeof v); }

// The first `count` lanes; kWhole says that count is kWidth.
template <bool kWhole>
inline Vector load(const float* p, int count) {
  if constexpr (kWhole) return load(p);
  Vector v = {};
  for (int i = 0; i < count; ++i) v[i] = p[i];
  return v;
}
template <bool kWhole>
inline void store(float* p, Vector v, int count) {
  if constexpr (kWhole) return store(p, v);
  for (int i = 0; i < count; ++i) p[i] = v[i];
}

inline double sum(Vector v) {
  double total = 0;
  for (int i = 0; i < kWidth; ++i) total += v[i];
  return total;
}

// e^x for x <= 0, relative error 2e-7; below -87, where the result would be subnormal, e^-87. NaN stays NaN.
inline Vector exp_nonpositive(Vector x) {
  x = x < -87.0f ? splat(-87.0f) : x;
  const Integers n = __builtin_convertvector(x * 1.44269504f - 0.5f, Integers);  // nearest, as x is not positive
  const Vector whole = __builtin_convertvector(n, Vector);
  const Vector r = x - whole * 0.693359375f + whole * 2.12194440e-4f;  // ln 2 in two parts
  Vector p = splat(1.0f / 5040);
  p = p * r + 1.0f / 720;
  p = p * r + 1.0f / 120;
  p = p * r + 1.0f / 24;
  p = p * r + 1.0f / 6;
  p = p * r + 0.5f;
  p = p * r + 1.0f;
  p = p * r + 1.0f;
  return p * reinterpret_cast<Vector>((n + 127) << 23);
}

}  // namespace aa4d::field::AA4D_ARCH

#pragma once

#include <immintrin.h>

#include <cstdint>

#define AA4D_ARCH avx2
#define AA4D_ARCH_NAME "avx2"

namespace aa4d::raster::avx2 {

struct Float {
  static constexpr int kWidth = 8;
  __m256 v;
  Float() = default;
  Float(__m256 value) : v(value) {}
  explicit Float(float value) : v(_mm256_set1_ps(value)) {}
  static Float load(const float* p) { return _mm256_load_ps(p); }
  void store(float* p) const { _mm256_store_ps(p, v); }
};
struct Mask {
  __m256 m;
};

inline Float operator+(Float a, Float b) { return _mm256_add_ps(a.v, b.v); }
inline Float operator-(Float a, Float b) { return _mm256_sub_ps(a.v, b.v); }
inline Float operator*(Float a, Float b) { return _mm256_mul_ps(a.v, b.v); }
inline Float fma(Float a, Float b, Float c) { return _mm256_fmadd_ps(a.v, b.v, c.v); }    // a b + c
inline Float fnma(Float a, Float b, Float c) { return _mm256_fnmadd_ps(a.v, b.v, c.v); }  // c - a b
inline Float min(Float a, Float b) { return _mm256_min_ps(a.v, b.v); }
inline Float max(Float a, Float b) { return _mm256_max_ps(a.v, b.v); }
inline Mask operator<=(Float a, Float b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_LE_OQ)}; }
inline Mask operator>=(Float a, Float b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GE_OQ)}; }
inline Mask operator>(Float a, Float b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GT_OQ)}; }
inline Mask operator&(Mask a, Mask b) { return {_mm256_and_ps(a.m, b.m)}; }
inline bool any(Mask a) { return _mm256_movemask_ps(a.m) != 0; }
inline std::uint32_t bits(Mask a) { return static_cast<std::uint32_t>(_mm256_movemask_ps(a.m)); }
inline Float select(Mask m, Float a, Float b) { return _mm256_blendv_ps(b.v, a.v, m.m); }
inline Float zero_unless(Mask m, Float a) { return _mm256_and_ps(m.m, a.v); }
inline Float square_root(Float a) { return _mm256_sqrt_ps(a.v); }
inline Float abs(Float a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a.v); }
inline float sum(Float a) {
  __m128 s = _mm_add_ps(_mm256_castps256_ps128(a.v), _mm256_extractf128_ps(a.v, 1));
  s = _mm_add_ps(s, _mm_movehl_ps(s, s));
  return _mm_cvtss_f32(_mm_add_ss(s, _mm_movehdup_ps(s)));
}

// Writes base + i for every bit i of the mask, in order; returns how many. May write up to 16 places.
inline int append_lanes(std::uint32_t mask, std::uint32_t base, std::uint32_t* out) {
  int count = 0;
  for (; mask != 0; mask &= mask - 1) out[count++] = base + __builtin_ctz(mask);
  return count;
}

// Bit i is set where words[i] has the one bit of `bit`; i below 16.
inline std::uint32_t words_with(const std::uint64_t* words, std::uint64_t bit) {
  std::uint32_t result = 0;
  for (int i = 0; i < 16; ++i) result |= static_cast<std::uint32_t>((words[i] & bit) != 0) << i;
  return result;
}

// Eight bytes, of which byte i has its lowest counts[i] bits set.
inline std::uint64_t low_bits(const float* counts) {
  std::uint64_t result = 0;
  for (int i = 0; i < 8; ++i) result |= ((std::uint64_t{1} << static_cast<int>(counts[i])) - 1) << 8 * i;
  return result;
}

// out[k] = the sum of the lanes of values[k], for 12 values; out[12..15] = 0.
inline void sum_each(const Float (&values)[12], float* out) {
  for (int k = 0; k < 12; ++k) out[k] = sum(values[k]);
  for (int k = 12; k < 16; ++k) out[k] = 0;
}

// A true division: one Newton step on the 12 bits of rcpps errs to one side, which adds up over thousands of layers.
inline Float reciprocal(Float a) { return _mm256_div_ps(_mm256_set1_ps(1.0f), a.v); }

// The lanes of p whose integer is above `value`.
inline Mask above(const std::int32_t* p, std::int32_t value) {
  const __m256i lanes = _mm256_load_si256(reinterpret_cast<const __m256i*>(p));
  return {_mm256_castsi256_ps(_mm256_cmpgt_epi32(lanes, _mm256_set1_epi32(value)))};
}
inline void store_where(Mask m, std::int32_t* p, std::int32_t value) {
  _mm256_maskstore_epi32(p, _mm256_castps_si256(m.m), _mm256_set1_epi32(value));
}

inline Float fraction(Float x) { return _mm256_sub_ps(x.v, _mm256_floor_ps(x.v)); }
inline Float scale_by_floor_exponent(Float a, Float x) {
  const __m256i exponent = _mm256_cvtps_epi32(_mm256_floor_ps(x.v));
  const __m256i power = _mm256_slli_epi32(_mm256_add_epi32(exponent, _mm256_set1_epi32(127)), 23);
  return _mm256_mul_ps(a.v, _mm256_castsi256_ps(power));
}

}  // namespace aa4d::raster::avx2

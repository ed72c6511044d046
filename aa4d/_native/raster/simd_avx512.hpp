#pragma once

#include <immintrin.h>

#include <cstdint>

#define AA4D_ARCH avx512
#define AA4D_ARCH_NAME "avx512"

namespace aa4d::raster::avx512 {

struct Float {
  static constexpr int kWidth = 16;
  __m512 v;
  Float() = default;
  Float(__m512 value) : v(value) {}
  explicit Float(float value) : v(_mm512_set1_ps(value)) {}
  static Float load(const float* p) { return _mm512_load_ps(p); }
  void store(float* p) const { _mm512_store_ps(p, v); }
};
struct Mask {
  __mmask16 m;
};

inline Float operator+(Float a, Float b) { return _mm512_add_ps(a.v, b.v); }
inline Float operator-(Float a, Float b) { return _mm512_sub_ps(a.v, b.v); }
inline Float operator*(Float a, Float b) { return _mm512_mul_ps(a.v, b.v); }
inline Float fma(Float a, Float b, Float c) { return _mm512_fmadd_ps(a.v, b.v, c.v); }    // a b + c
inline Float fnma(Float a, Float b, Float c) { return _mm512_fnmadd_ps(a.v, b.v, c.v); }  // c - a b
inline Float min(Float a, Float b) { return _mm512_min_ps(a.v, b.v); }
inline Float max(Float a, Float b) { return _mm512_max_ps(a.v, b.v); }
inline Mask operator<=(Float a, Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ)}; }
inline Mask operator>=(Float a, Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GE_OQ)}; }
inline Mask operator>(Float a, Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GT_OQ)}; }
inline Mask operator&(Mask a, Mask b) { return {static_cast<__mmask16>(a.m & b.m)}; }
inline bool any(Mask a) { return a.m != 0; }
inline std::uint32_t bits(Mask a) { return a.m; }
inline Float select(Mask m, Float a, Float b) { return _mm512_mask_blend_ps(m.m, b.v, a.v); }
inline Float zero_unless(Mask m, Float a) { return _mm512_maskz_mov_ps(m.m, a.v); }
inline Float square_root(Float a) { return _mm512_sqrt_ps(a.v); }
inline Float abs(Float a) { return _mm512_abs_ps(a.v); }
inline float sum(Float a) { return _mm512_reduce_add_ps(a.v); }

// Writes base + i for every bit i of the mask, in order; returns how many. May write up to 16 places.
inline int append_lanes(std::uint32_t mask, std::uint32_t base, std::uint32_t* out) {
  const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  const __m512i all = _mm512_add_epi32(lanes, _mm512_set1_epi32(static_cast<int>(base)));
  _mm512_storeu_si512(out, _mm512_maskz_compress_epi32(static_cast<__mmask16>(mask), all));
  return __builtin_popcount(mask);
}

// Bit i is set where words[i] has the one bit of `bit`; i below 16.
inline std::uint32_t words_with(const std::uint64_t* words, std::uint64_t bit) {
  const __m512i wanted = _mm512_set1_epi64(static_cast<long long>(bit));
  const std::uint32_t low = _mm512_test_epi64_mask(_mm512_load_si512(words), wanted);
  return low | static_cast<std::uint32_t>(_mm512_test_epi64_mask(_mm512_load_si512(words + 8), wanted)) << 8;
}

// Eight bytes, of which byte i has its lowest counts[i] bits set.
inline std::uint64_t low_bits(const float* counts) {
  const __m256i one = _mm256_set1_epi32(1), shift = _mm256_cvttps_epi32(_mm256_load_ps(counts));
  const __m256i low = _mm256_sub_epi32(_mm256_sllv_epi32(one, shift), one);
  return static_cast<std::uint64_t>(_mm_cvtsi128_si64(_mm256_cvtepi32_epi8(low)));
}

// out[k] = the sum of the lanes of values[k], for 12 values; out[12..15] = 0. Halves are added pairwise while they are
// interleaved: 9 instructions for four values instead of 8 for each.
inline void sum_each(const Float (&values)[12], float* out) {
  __m512 quads[4];  // each 128-bit lane holds four partial sums of one value
  for (int i = 0; i < 3; ++i) {
    const __m512 a = values[4 * i].v, b = values[4 * i + 1].v, c = values[4 * i + 2].v, d = values[4 * i + 3].v;
    const __m512 ab = _mm512_add_ps(_mm512_shuffle_f32x4(a, b, 0x44), _mm512_shuffle_f32x4(a, b, 0xee));
    const __m512 cd = _mm512_add_ps(_mm512_shuffle_f32x4(c, d, 0x44), _mm512_shuffle_f32x4(c, d, 0xee));
    quads[i] = _mm512_add_ps(_mm512_shuffle_f32x4(ab, cd, 0x88), _mm512_shuffle_f32x4(ab, cd, 0xdd));
  }
  quads[3] = _mm512_setzero_ps();
  const __m512 low = _mm512_add_ps(_mm512_unpacklo_ps(quads[0], quads[1]), _mm512_unpackhi_ps(quads[0], quads[1]));
  const __m512 high = _mm512_add_ps(_mm512_unpacklo_ps(quads[2], quads[3]), _mm512_unpackhi_ps(quads[2], quads[3]));
  const __m512 sums = _mm512_add_ps(_mm512_shuffle_ps(low, high, 0x44), _mm512_shuffle_ps(low, high, 0xee));
  // Lane i holds values i, 4 + i, 8 + i.
  const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  _mm512_store_ps(out, _mm512_permutexvar_ps(order, sums));
}

// 1 / a to the last bit or two.
inline Float reciprocal(Float a) {
  const __m512 r = _mm512_rcp14_ps(a.v);
  return _mm512_mul_ps(r, _mm512_fnmadd_ps(a.v, r, _mm512_set1_ps(2.0f)));
}

// The lanes of p whose integer is above `value`.
inline Mask above(const std::int32_t* p, std::int32_t value) {
  return {_mm512_cmpgt_epi32_mask(_mm512_load_si512(p), _mm512_set1_epi32(value))};
}
inline void store_where(Mask m, std::int32_t* p, std::int32_t value) {
  _mm512_mask_store_epi32(p, m.m, _mm512_set1_epi32(value));
}

inline Float fraction(Float x) { return _mm512_reduce_ps(x.v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
inline Float scale_by_floor_exponent(Float a, Float x) { return _mm512_scalef_ps(a.v, x.v); }

}  // namespace aa4d::raster::avx512

// Four lanes in the vector types of GCC and Clang: SSE2 on x86-64, NEON on arm64.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#define AA4D_ARCH portable
#define AA4D_ARCH_NAME "portable"

namespace aa4d::raster::portable {

using Lanes = float __attribute__((vector_size(16)));
using IntLanes = std::int32_t __attribute__((vector_size(16)));

struct Float {
  static constexpr int kWidth = 4;
  Lanes v;
  Float() = default;
  Float(Lanes value) : v(value) {}
  explicit Float(float value) : v{value, value, value, value} {}
  static Float load(const float* p) {
    Float result;
    std::memcpy(&result.v, p, sizeof(Lanes));
    return result;
  }
  void store(float* p) const { std::memcpy(p, &v, sizeof(Lanes)); }
};
struct Mask {
  IntLanes m;
};

inline Float operator+(Float a, Float b) { return a.v + b.v; }
inline Float operator-(Float a, Float b) { return a.v - b.v; }
inline Float operator*(Float a, Float b) { return a.v * b.v; }
inline Float fma(Float a, Float b, Float c) { return a.v * b.v + c.v; }   // not fused: SSE2 has no such instruction
inline Float fnma(Float a, Float b, Float c) { return c.v - a.v * b.v; }
inline Float min(Float a, Float b) { return a.v < b.v ? a.v : b.v; }
inline Float max(Float a, Float b) { return a.v > b.v ? a.v : b.v; }
inline Mask operator<=(Float a, Float b) { return {a.v <= b.v}; }
inline Mask operator>=(Float a, Float b) { return {a.v >= b.v}; }
inline Mask operator>(Float a, Float b) { return {a.v > b.v}; }
inline Mask operator&(Mask a, Mask b) { return {a.m & b.m}; }
inline std::uint32_t bits(Mask a) {
  std::uint32_t result = 0;
  for (int i = 0; i < 4; ++i) result |= (a.m[i] & 1u) << i;
  return result;
}
inline bool any(Mask a) { return (a.m[0] | a.m[1] | a.m[2] | a.m[3]) != 0; }
inline Float select(Mask m, Float a, Float b) { return m.m ? a.v : b.v; }
inline Float zero_unless(Mask m, Float a) { return Lanes(m.m & IntLanes(a.v)); }
inline Float square_root(Float a) {
  return Lanes{__builtin_sqrtf(a.v[0]), __builtin_sqrtf(a.v[1]), __builtin_sqrtf(a.v[2]), __builtin_sqrtf(a.v[3])};
}
inline Float abs(Float a) { return Lanes(IntLanes(a.v) & 0x7fffffff); }
inline float sum(Float a) { return (a.v[0] + a.v[2]) + (a.v[1] + a.v[3]); }
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
inline Float reciprocal(Float a) { return 1.0f / a.v; }

// The lanes of p whose integer is above `value`.
inline Mask above(const std::int32_t* p, std::int32_t value) {
  IntLanes lanes;
  std::memcpy(&lanes, p, sizeof lanes);
  return {lanes > value};
}
inline void store_where(Mask m, std::int32_t* p, std::int32_t value) {
  for (int i = 0; i < 4; ++i) {
    if (m.m[i]) p[i] = value;
  }
}

inline IntLanes floor_to_int(Float x) {
  const IntLanes truncated = __builtin_convertvector(x.v, IntLanes);
  return truncated + (__builtin_convertvector(truncated, Lanes) > x.v);  // a true comparison is -1
}
inline Float fraction(Float x) { return x.v - __builtin_convertvector(floor_to_int(x), Lanes); }
inline Float scale_by_floor_exponent(Float a, Float x) { return a.v * Lanes((floor_to_int(x) + 127) << 23); }

}  // namespace aa4d::raster::portable

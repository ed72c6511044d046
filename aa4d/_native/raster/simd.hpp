// Vectors of floats for the kernels: `Float` (kWidth lanes), `Mask`, and the functions below, in a namespace of their
// own for each instruction set. Only kernels_*.cpp include this file; they keep to raw pointers, because an inline
// function of the standard library compiled for AVX-512 could be the copy that the linker keeps for everyone.
#pragma once

#include "raster/constants.hpp"

#if defined(__AVX512F__)
#include "raster/simd_avx512.hpp"
#elif defined(__AVX2__)
#include "raster/simd_avx2.hpp"
#else
#include "raster/simd_portable.hpp"
#endif

namespace aa4d::raster::AA4D_ARCH {

// 2^x for -126 < x <= 0, relative error 1e-7: 2^floor(x) times the minimax polynomial of degree 5 for 2^f on [0, 1).
inline Float exp2_nonpositive(Float x) {
  const Float f = fraction(x);
  Float p = Float(0.001877576671f);
  p = fma(p, f, Float(0.00898934034f));
  p = fma(p, f, Float(0.05582631759f));
  p = fma(p, f, Float(0.2401536173f));
  p = fma(p, f, Float(0.6931530731f));
  p = fma(p, f, Float(0.9999999251f));
  return scale_by_floor_exponent(p, x);
}

inline constexpr int kBlockVectors = kBlockPixels / Float::kWidth;  // vectors in a block of pixels
inline constexpr int kMapVectors = kTileBlocks / Float::kWidth;     // vectors over the blocks of a tile

}  // namespace aa4d::raster::AA4D_ARCH

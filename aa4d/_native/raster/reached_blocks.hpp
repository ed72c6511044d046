// Which blocks of a tile a splat can reach: the exact test, a row of blocks at a time.
#pragma once

#include "raster/kernels.hpp"
#include "raster/simd.hpp"

namespace aa4d::raster::AA4D_ARCH {

// Lanes 0 to 7: the right ends of the ellipse in the eight rows of blocks; lanes 8 to 15: the left ends.
struct RowEnds {
  alignas(64) float top[16], side[16];

  constexpr RowEnds() : top(), side() {
    for (int i = 0; i < 16; ++i) {
      top[i] = i % kRowBlocks * kBlockSize + 0.5f;
      side[i] = i < kRowBlocks ? 1.0f : -1.0f;
    }
  }
};
inline constexpr RowEnds kRowEnds;

// One bit for each block, row by row, of the tile whose first pixel is (x, y): no pixel of the others passes the
// cut-off.
//
// An ellipse is convex, so what a band of rows holds of it spans an interval of columns, and it touches exactly the
// blocks on that interval. The end on the side s = 1 or -1 lies at the ellipse's own rightmost or leftmost point, or on
// the band's border nearest to that.
inline std::uint64_t reached_blocks(const Splat& splat, int x, int y) {
  const double dx = splat.x - x, dy = splat.y - y;  // of the centre, from the tile's corner
  const float a = static_cast<float>(splat.l11), b = static_cast<float>(splat.l21), c = static_cast<float>(splat.l22);
  // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
  constexpr double kFar = 2048;
  constexpr float kFlat = 1e-9f;
  if (!(dx < kFar && dx > -kFar && dy < kFar && dy > -kFar && a > kFlat && c > kFlat)) return ~std::uint64_t{0};

  constexpr float kSlack = 0.02f;  // px, and a little of the reach: for rounding, so that nothing is lost
  const float reach = splat.reach * 1.001f + 0.001f;
  const float root = __builtin_sqrtf(reach), tip = root / c;                    // the ellipse's topmost and lowest y
  const float widest = -b * root / (c * __builtin_sqrtf(c * c + b * b));        // the y of its rightmost point
  const Float inverse_a(1.0f / a), steepness(-b), c_lanes(c), reach_lanes(reach), zero(0.0f);
  const Float center_x(static_cast<float>(dx)), center_y(static_cast<float>(dy));
  alignas(64) float ends[16];
  for (int i = 0; i < 16; i += Float::kWidth) {
    const Float side = Float::load(kRowEnds.side + i);
    const Float top = Float::load(kRowEnds.top + i) - center_y;
    const Float low = max(top - Float(kSlack), Float(-tip)),
                high = min(top + Float(kBlockSize - 1 + kSlack), Float(tip));
    const Float at = min(max(side * Float(widest), low), high), w = c_lanes * at;
    const Float half = square_root(max(fnma(w, w, reach_lanes), zero));
    const Float column = fma(fma(side, half, steepness * at), inverse_a, center_x);
    // Blocks begin half a pixel after every fourth column, and end half a pixel before. A right end counts the blocks
    // that begin before it, a left end those that end before it.
    const Float blocks = (side * column + Float(kSlack + kBlockSize - 0.5f)) * Float(1.0f / kBlockSize);
    const Float limited = max(min(blocks, Float(kRowBlocks + 1.0f)), Float(-kRowBlocks - 1.0f));
    const Float count = side * (limited - fraction(limited));
    zero_unless(low <= high, max(min(count, Float(kRowBlocks)), zero)).store(ends + i);
  }
  return low_bits(ends) & ~low_bits(ends + kRowBlocks);
}

}  // namespace aa4d::raster::AA4D_ARCH

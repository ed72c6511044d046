// A splat seen from one quarter of a tile: which blocks of pixels it can reach, and where they lie in its (u, w) frame.
#pragma once

#include "kernels.hpp"
#include "simd.hpp"

namespace aa4d::AA4D_ARCH {

struct BlockGrid {
  alignas(64) float x[kQuarterBlocks], y[kQuarterBlocks];  // centre of a block's first pixel, from the quarter's corner
  alignas(64) float px[kBlockPixels], py[kBlockPixels];    // offset of a block's pixels from its first one
};

inline constexpr BlockGrid make_block_grid() {
  constexpr int kAcross = kQuarterSize / kBlockSize;
  BlockGrid grid{};
  for (int i = 0; i < kQuarterBlocks; ++i) {
    grid.x[i] = kBlockSize * (i % kAcross) + 0.5f;
    grid.y[i] = kBlockSize * (i / kAcross) + 0.5f;
  }
  for (int i = 0; i < kBlockPixels; ++i) {
    grid.px[i] = i % kBlockSize;
    grid.py[i] = i / kBlockSize;
  }
  return grid;
}
inline constexpr BlockGrid kGrid = make_block_grid();

struct alignas(64) QuarterView {
  float u_pixel[kBlockPixels], w_pixel[kBlockPixels];      // of a block's pixels, from its first one
  float u_block[kQuarterBlocks], w_block[kQuarterBlocks];  // of every block's first pixel
  float log2_opacity, color[3], depth, l21, l22;
  std::uint32_t gaussian;
  std::int32_t place;  // in the tile's list

  // `x`, `y`: the quarter's first pixel. Returns one bit for each block; no pixel of the others passes the cut-off.
  std::uint32_t look(const Splat& splat, int x, int y) {
    const double dx = x - splat.x, dy = y - splat.y;
    l21 = static_cast<float>(splat.l21);
    l22 = static_cast<float>(splat.l22);
    log2_opacity = splat.log2_opacity;
    depth = splat.depth;
    for (int k = 0; k < 3; ++k) color[k] = splat.color[k];

    const Float a(static_cast<float>(splat.l11)), b(l21), c(l22);
    const Float u0(static_cast<float>(splat.l11 * dx + splat.l21 * dy)), w0(static_cast<float>(splat.l22 * dy));
    for (int i = 0; i < kQuarterBlocks; i += Float::kWidth) {
      const Float block_x = Float::load(kGrid.x + i), block_y = Float::load(kGrid.y + i);
      fma(a, block_x, fma(b, block_y, u0)).store(u_block + i);
      fma(c, block_y, w0).store(w_block + i);
    }
    for (int i = 0; i < kBlockPixels; i += Float::kWidth) {
      const Float px = Float::load(kGrid.px + i), py = Float::load(kGrid.py + i);
      fma(a, px, b * py).store(u_pixel + i);
      (c * py).store(w_pixel + i);
    }
    // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
    constexpr double kFar = 2048;
    const bool near = dx < kFar && dx > -kFar && dy < kFar && dy > -kFar;
    return near ? reached(a, b, c, splat.reach, static_cast<float>(dx), static_cast<float>(dy))
                : (1u << kQuarterBlocks) - 1;
  }

  // Of the kWidth pixels of a block from `pixel` on.
  Float u(int block, int pixel) const { return Float::load(u_pixel + pixel) + Float(u_block[block]); }
  Float w(int block, int pixel) const { return Float::load(w_pixel + pixel) + Float(w_block[block]); }

  // log2 of alpha, before the clamp.
  Float log2_alpha(Float u, Float w) const { return fnma(w, w, fnma(u, u, Float(log2_opacity))); }

 private:
  // The smallest u^2 + w^2 over a block's rectangle of pixel centres lies on a side that faces the splat's centre: on
  // the vertical one, at the best y for its x, or on the horizontal one, at the best x for its y.
  static std::uint32_t reached(Float l11, Float l21, Float l22, float reach, float dx, float dy) {
    const Float zero(0.0f), extent(kBlockSize - 1.0f);
    const Float best_y = zero - l11 * l21 * reciprocal(fma(l21, l21, l22 * l22)), best_x = zero - l21 * reciprocal(l11);
    const Float limit(reach * 1.001f + 0.001f);  // rounding must not lose a pixel that its own test would take
    std::uint32_t result = 0;
    for (int i = 0; i < kQuarterBlocks; i += Float::kWidth) {
      const Float x_first = Float::load(kGrid.x + i) + Float(dx), x_last = x_first + extent;
      const Float y_first = Float::load(kGrid.y + i) + Float(dy), y_last = y_first + extent;
      const Float x_side = max(x_first, min(zero, x_last)), y_side = max(y_first, min(zero, y_last));
      const Float y_on = max(y_first, min(best_y * x_side, y_last));
      const Float x_on = max(x_first, min(best_x * y_side, x_last));
      const Float u_a = fma(l11, x_side, l21 * y_on), w_a = l22 * y_on;
      const Float u_b = fma(l11, x_on, l21 * y_side), w_b = l22 * y_side;
      const Float nearest = min(fma(u_a, u_a, w_a * w_a), fma(u_b, u_b, w_b * w_b));
      result |= bits(nearest <= limit) << i;
    }
    return result;
  }
};

}  // namespace aa4d::AA4D_ARCH

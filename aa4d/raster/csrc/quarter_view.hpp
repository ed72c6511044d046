// A splat seen from one quarter of a tile: which blocks of pixels it can reach, and where they lie in its (u, w) frame.
#pragma once

#include "ellipse.hpp"
#include "grid.hpp"
#include "kernels.hpp"

namespace aa4d::AA4D_ARCH {

struct alignas(64) QuarterView {
  float u_pixel[kBlockPixels], w_pixel[kBlockPixels];      // of a block's pixels, from its first one
  float u_block[kQuarterBlocks], w_block[kQuarterBlocks];  // of every block's first pixel
  float log2_opacity, color[3], depth, l21, l22;
  std::uint32_t gaussian;
  std::int32_t place;  // in the tile's list

  // `x`, `y`: the quarter's first pixel.
  void look(const Splat& splat, int x, int y) {
    const double dx = x - splat.x, dy = y - splat.y;
    l21 = static_cast<float>(splat.l21);
    l22 = static_cast<float>(splat.l22);
    log2_opacity = splat.log2_opacity;
    depth = splat.depth;
    for (int k = 0; k < 3; ++k) color[k] = splat.color[k];

    const Float a(static_cast<float>(splat.l11)), b(l21), c(l22);
    const Float u0(static_cast<float>(splat.l11 * dx + splat.l21 * dy)), w0(static_cast<float>(splat.l22 * dy));
    for (int i = 0; i < kQuarterBlocks; i += Float::kWidth) {
      const Float block_x = Float::load(kGrid.block_x + i), block_y = Float::load(kGrid.block_y + i);
      fma(a, block_x, fma(b, block_y, u0)).store(u_block + i);
      fma(c, block_y, w0).store(w_block + i);
    }
    for (int i = 0; i < kBlockPixels; i += Float::kWidth) {
      const Float px = Float::load(kGrid.column + i), py = Float::load(kGrid.row + i);
      fma(a, px, b * py).store(u_pixel + i);
      (c * py).store(w_pixel + i);
    }
  }

  // Of the kWidth pixels of a block from `pixel` on.
  Float u(int block, int pixel) const { return Float::load(u_pixel + pixel) + Float(u_block[block]); }
  Float w(int block, int pixel) const { return Float::load(w_pixel + pixel) + Float(w_block[block]); }

  // log2 of alpha, before the clamp.
  Float log2_alpha(Float u, Float w) const { return fnma(w, w, fnma(u, u, Float(log2_opacity))); }
};

// The blocks of a quarter that a splat may reach, one bit each: no pixel of the others passes the cut-off.
inline std::uint32_t reached_blocks(const Splat& splat, int x, int y) {
  const double dx = x - splat.x, dy = y - splat.y;
  // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
  constexpr double kFar = 2048;
  if (!(dx < kFar && dx > -kFar && dy < kFar && dy > -kFar)) return (1u << kQuarterBlocks) - 1;
  const Ellipse ellipse(Float(static_cast<float>(splat.l11)), Float(static_cast<float>(splat.l21)),
                        Float(static_cast<float>(splat.l22)), splat.reach);
  const Float extent(kBlockSize - 1.0f), x0(static_cast<float>(dx)), y0(static_cast<float>(dy));
  std::uint32_t result = 0;
  for (int i = 0; i < kQuarterBlocks; i += Float::kWidth) {
    const Float left = Float::load(kGrid.block_x + i) + x0, top = Float::load(kGrid.block_y + i) + y0;
    result |= bits(ellipse.touches(left, left + extent, top, top + extent)) << i;
  }
  return result;
}

}  // namespace aa4d::AA4D_ARCH

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
      const Float block_x = Float::load(kGrid.block_x + i), block_y = Float::load(kGrid.block_y + i);
      fma(a, block_x, fma(b, block_y, u0)).store(u_block + i);
      fma(c, block_y, w0).store(w_block + i);
    }
    for (int i = 0; i < kBlockPixels; i += Float::kWidth) {
      const Float px = Float::load(kGrid.column + i), py = Float::load(kGrid.row + i);
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
  static std::uint32_t reached(Float l11, Float l21, Float l22, float reach, float dx, float dy) {
    const Ellipse ellipse(l11, l21, l22, reach);
    const Float extent(kBlockSize - 1.0f);
    std::uint32_t result = 0;
    for (int i = 0; i < kQuarterBlocks; i += Float::kWidth) {
      const Float x = Float::load(kGrid.block_x + i) + Float(dx), y = Float::load(kGrid.block_y + i) + Float(dy);
      result |= bits(ellipse.touches(x, x + extent, y, y + extent)) << i;
    }
    return result;
  }
};

}  // namespace aa4d::AA4D_ARCH

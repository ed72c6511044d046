// Which blocks of a tile a Gaussian can reach, and where they lie in its (u, w) frame: one lane for each block.
#pragma once

#include "kernels.hpp"
#include "simd.hpp"

namespace aa4d::AA4D_ARCH {

struct alignas(64) PerBlock {
  float lane[kTileBlocks];
};

struct alignas(64) PerPixelOfBlock {
  float lane[kBlockPixels];
};

struct BlockGrid {
  PerBlock x, y;            // centre of a block's first pixel, from the tile's corner
  PerPixelOfBlock px, py;   // offset of a block's pixels from its first one
};

inline constexpr BlockGrid make_block_grid() {
  constexpr int kAcross = kTileSize / kBlockSize;
  BlockGrid grid{};
  for (int i = 0; i < kTileBlocks; ++i) {
    grid.x.lane[i] = kBlockSize * (i % kAcross) + 0.5f;
    grid.y.lane[i] = kBlockSize * (i / kAcross) + 0.5f;
  }
  for (int i = 0; i < kBlockPixels; ++i) {
    grid.px.lane[i] = i % kBlockSize;
    grid.py.lane[i] = i / kBlockSize;
  }
  return grid;
}
alignas(64) inline constexpr BlockGrid kGrid = make_block_grid();

// A Gaussian seen from one tile.
struct BlockMap {
  PerBlock u, w;         // of every block's first pixel
  std::uint32_t reached; // one bit for each block: no pixel of the others passes the cut-off

  void build(const Splat& splat, int tile_x, int tile_y) {
    const double dx = tile_x - splat.x, dy = tile_y - splat.y;
    const Float l11(static_cast<float>(splat.l11)), l21(static_cast<float>(splat.l21));
    const Float l22(static_cast<float>(splat.l22));
    const Float u0(static_cast<float>(splat.l11 * dx + splat.l21 * dy)), w0(static_cast<float>(splat.l22 * dy));
    for (int i = 0; i < kTileBlocks; i += Float::kWidth) {
      const Float bx = Float::load(kGrid.x.lane + i), by = Float::load(kGrid.y.lane + i);
      fma(l11, bx, fma(l21, by, u0)).store(u.lane + i);
      fma(l22, by, w0).store(w.lane + i);
    }
    // Far from the centre single precision cannot place the ellipse's edge; such a Gaussian is large anyway.
    constexpr double kFar = 2048;
    const bool near = dx < kFar && dx > -kFar && dy < kFar && dy > -kFar;
    reached = near ? reached_blocks(splat, static_cast<float>(dx), static_cast<float>(dy)) : (1u << kTileBlocks) - 1;
  }

 private:
  // The smallest u^2 + w^2 over a block's rectangle of pixel centres lies on an edge that faces the Gaussian's centre:
  // on the vertical one, at the best y for its x, or on the horizontal one, at the best x for its y.
  static std::uint32_t reached_blocks(const Splat& splat, float dx, float dy) {
    const float s11 = static_cast<float>(splat.l11), s21 = static_cast<float>(splat.l21);
    const float s22 = static_cast<float>(splat.l22);
    const Float l11(s11), l21(s21), l22(s22), zero(0.0f), width(kBlockSize - 1.0f);
    const Float best_y(-s11 * s21 / (s21 * s21 + s22 * s22)), best_x(-s21 / s11);
    const Float limit(splat.reach * 1.001f + 0.001f);  // rounding must not lose a pixel that its own test would take
    std::uint32_t result = 0;
    for (int i = 0; i < kTileBlocks; i += Float::kWidth) {
      const Float x_first = Float::load(kGrid.x.lane + i) + Float(dx), x_last = x_first + width;
      const Float y_first = Float::load(kGrid.y.lane + i) + Float(dy), y_last = y_first + width;
      const Float x_edge = max(x_first, min(zero, x_last)), y_edge = max(y_first, min(zero, y_last));
      const Float y_on = max(y_first, min(best_y * x_edge, y_last));
      const Float x_on = max(x_first, min(best_x * y_edge, x_last));
      const Float u_a = fma(l11, x_edge, l21 * y_on), w_a = l22 * y_on;
      const Float u_b = fma(l11, x_on, l21 * y_edge), w_b = l22 * y_edge;
      const Float nearest = min(fma(u_a, u_a, w_a * w_a), fma(u_b, u_b, w_b * w_b));
      result |= bits(nearest <= limit) << i;
    }
    return result;
  }
};

}  // namespace aa4d::AA4D_ARCH

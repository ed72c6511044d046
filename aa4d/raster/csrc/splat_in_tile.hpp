// A splat seen from one tile: which blocks of pixels it can reach, and where they lie in its (u, w) frame.
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
  PerBlock x, y;           // centre of a block's first pixel, from the tile's corner
  PerPixelOfBlock px, py;  // offset of a block's pixels from its first one
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

class SplatInTile {
 public:
  SplatInTile(const Splat& splat, int tile_x, int tile_y)
      : l11(static_cast<float>(splat.l11)), l21(static_cast<float>(splat.l21)), l22(static_cast<float>(splat.l22)),
        log2_opacity_(splat.log2_opacity) {
    const double dx = tile_x - splat.x, dy = tile_y - splat.y;
    const Float u0(static_cast<float>(splat.l11 * dx + splat.l21 * dy)), w0(static_cast<float>(splat.l22 * dy));
    for (int i = 0; i < kTileBlocks; i += Float::kWidth) {
      const Float bx = Float::load(kGrid.x.lane + i), by = Float::load(kGrid.y.lane + i);
      fma(l11, bx, fma(l21, by, u0)).store(u_block_.lane + i);
      fma(l22, by, w0).store(w_block_.lane + i);
    }
    for (int k = 0; k < kBlockVectors; ++k) {
      const Float px = Float::load(kGrid.px.lane + k * Float::kWidth), py = Float::load(kGrid.py.lane + k * Float::kWidth);
      u_pixel_[k] = fma(l11, px, l21 * py);
      w_pixel_[k] = l22 * py;
    }
    // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
    constexpr double kFar = 2048;
    const bool near = dx < kFar && dx > -kFar && dy < kFar && dy > -kFar;
    reached_ = near ? find_reached(splat.reach, static_cast<float>(dx), static_cast<float>(dy)) : (1u << kTileBlocks) - 1;
  }

  // One bit for each block; no pixel of the others passes the cut-off.
  std::uint32_t reached() const { return reached_; }

  // Of the pixels in vector k of a block.
  Float u(int block, int k) const { return u_pixel_[k] + Float(u_block_.lane[block]); }
  Float w(int block, int k) const { return w_pixel_[k] + Float(w_block_.lane[block]); }

  // log2 of alpha, before the clamp.
  Float log2_alpha(Float u, Float w) const { return fnma(w, w, fnma(u, u, log2_opacity_)); }

  const Float l11, l21, l22;

 private:
  // The smallest u^2 + w^2 over a block's rectangle of pixel centres lies on an edge that faces the splat's centre: on
  // the vertical one, at the best y for its x, or on the horizontal one, at the best x for its y.
  std::uint32_t find_reached(float reach, float dx, float dy) const {
    const Float zero(0.0f), extent(kBlockSize - 1.0f);
    const Float best_y = zero - l11 * l21 * reciprocal(fma(l21, l21, l22 * l22)), best_x = zero - l21 * reciprocal(l11);
    const Float limit(reach * 1.001f + 0.001f);  // rounding must not lose a pixel that its own test would take
    std::uint32_t result = 0;
    for (int i = 0; i < kTileBlocks; i += Float::kWidth) {
      const Float x_first = Float::load(kGrid.x.lane + i) + Float(dx), x_last = x_first + extent;
      const Float y_first = Float::load(kGrid.y.lane + i) + Float(dy), y_last = y_first + extent;
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

  const Float log2_opacity_;
  PerBlock u_block_, w_block_;  // of every block's first pixel
  Float u_pixel_[kBlockVectors], w_pixel_[kBlockVectors];
  std::uint32_t reached_;
};

}  // namespace aa4d::AA4D_ARCH

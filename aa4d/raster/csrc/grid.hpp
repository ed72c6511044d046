// Sixteen things in four rows of four: the pixels of a block, the blocks of a quarter, the quarters of a group of tiles.
#pragma once

#include "simd.hpp"

namespace aa4d::AA4D_ARCH {

static_assert(kBlockPixels == 16 && kQuarterBlocks == 16 && kGroupQuarters == 16);

struct Grid {
  alignas(64) float column[16], row[16];
  alignas(64) float block_x[16], block_y[16];  // centre of a block's first pixel, from the quarter's corner
};

inline constexpr Grid make_grid() {
  Grid grid{};
  for (int i = 0; i < 16; ++i) {
    grid.column[i] = i % 4;
    grid.row[i] = i / 4;
    grid.block_x[i] = kBlockSize * (i % 4) + 0.5f;
    grid.block_y[i] = kBlockSize * (i / 4) + 0.5f;
  }
  return grid;
}
inline constexpr Grid kGrid = make_grid();

}  // namespace aa4d::AA4D_ARCH

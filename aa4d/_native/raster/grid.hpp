// Where things lie that are worked on side by side: the pixels of a tile, and the tiles of a group of four by four.
#pragma once

#include "raster/simd.hpp"

namespace aa4d::raster::AA4D_ARCH {

struct Grid {
  alignas(64) float pixel_x[kTilePixels], pixel_y[kTilePixels];  // centres, from the tile's centre
  alignas(64) float tile_x[kGroupTiles], tile_y[kGroupTiles];    // the first pixel's centre, from the group's corner
};

inline constexpr Grid make_grid() {
  Grid grid{};
  for (int i = 0; i < kTilePixels; ++i) {
    const int block = i / kBlockPixels, pixel = i % kBlockPixels;
    grid.pixel_x[i] = block % kRowBlocks * kBlockSize + pixel % kBlockSize + 0.5f - kTileSize / 2;
    grid.pixel_y[i] = block / kRowBlocks * kBlockSize + pixel / kBlockSize + 0.5f - kTileSize / 2;
  }
  for (int i = 0; i < kGroupTiles; ++i) {
    grid.tile_x[i] = i % kGroupSize * kTileSize + 0.5f;
    grid.tile_y[i] = i / kGroupSize * kTileSize + 0.5f;
  }
  return grid;
}
inline constexpr Grid kGrid = make_grid();

}  // namespace aa4d::raster::AA4D_ARCH

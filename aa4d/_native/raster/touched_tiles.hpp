// The tiles that a splat touches: the exact test, on those of the box around its ellipse.
#pragma once

#include "raster/ellipse.hpp"
#include "raster/grid.hpp"
#include "raster/kernels.hpp"

namespace aa4d::raster::AA4D_ARCH {

// One bit for each tile of a group of 4x4, row by row, whose first one is at (column, row). Tiles are clipped to the
// image.
inline std::uint32_t touched_tiles(const Splat& splat, const CameraModel& camera, int column, int row) {
  const double dx = column * kTileSize - splat.x, dy = row * kTileSize - splat.y;
  // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
  constexpr double kFar = 4096;
  if (!(dx < kFar && dx > -kFar && dy < kFar && dy > -kFar)) return (1u << kGroupTiles) - 1;
  const Ellipse ellipse(Float(static_cast<float>(splat.l11)), Float(static_cast<float>(splat.l21)),
                        Float(static_cast<float>(splat.l22)), splat.reach);
  const Float extent(kTileSize - 1.0f), corner_x(static_cast<float>(dx)), corner_y(static_cast<float>(dy));
  const Float x_end(static_cast<float>(camera.width - 0.5 - splat.x)),
      y_end(static_cast<float>(camera.height - 0.5 - splat.y));
  std::uint32_t result = 0;
  for (int i = 0; i < kGroupTiles; i += Float::kWidth) {
    const Float x = Float::load(kGrid.tile_x + i) + corner_x, y = Float::load(kGrid.tile_y + i) + corner_y;
    result |= bits(ellipse.touches(x, min(x + extent, x_end), y, min(y + extent, y_end))) << i;
  }
  return result;
}

}  // namespace aa4d::raster::AA4D_ARCH

// The quarters of tiles that a splat touches: the exact test, on the quarters of the box around its ellipse.
#pragma once

#include "ellipse.hpp"
#include "grid.hpp"
#include "kernels.hpp"

namespace aa4d::AA4D_ARCH {

// One bit for each quarter of a group of 4x4, row by row, whose first one is at (column, row). Quarters are clipped to
// the image.
inline std::uint32_t touched_quarters(const Splat& splat, const CameraModel& camera, int column, int row) {
  const double dx = column * kQuarterSize - splat.x, dy = row * kQuarterSize - splat.y;
  // Far from the centre single precision cannot place the ellipse's edge; such a splat is large anyway.
  constexpr double kFar = 4096;
  if (!(dx < kFar && dx > -kFar && dy < kFar && dy > -kFar)) return 0xffff;
  const Ellipse ellipse(Float(static_cast<float>(splat.l11)), Float(static_cast<float>(splat.l21)),
                        Float(static_cast<float>(splat.l22)), splat.reach);
  const Float extent(kQuarterSize - 1.0f);
  const Float x_end(static_cast<float>(camera.width - 0.5 - splat.x)), y_end(static_cast<float>(camera.height - 0.5 - splat.y));
  std::uint32_t result = 0;
  for (int i = 0; i < kGroupQuarters; i += Float::kWidth) {
    const Float x = fma(Float::load(kGrid.column + i), Float(kQuarterSize), Float(static_cast<float>(dx + 0.5)));
    const Float y = fma(Float::load(kGrid.row + i), Float(kQuarterSize), Float(static_cast<float>(dy + 0.5)));
    result |= bits(ellipse.touches(x, min(x + extent, x_end), y, min(y + extent, y_end))) << i;
  }
  return result;
}

}  // namespace aa4d::AA4D_ARCH

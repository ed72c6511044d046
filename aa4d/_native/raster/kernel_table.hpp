// The kernels of the instruction set that the including file is compiled for.
#pragma once

#include "raster/arithmetic.hpp"
#include "raster/blend_backward.hpp"
#include "raster/blend_forward.hpp"
#include "raster/projection.hpp"
#include "raster/projection_backward.hpp"
#include "raster/touched_tiles.hpp"

namespace aa4d::raster::AA4D_ARCH {

inline void forward(const ForwardTile& tile) {
  tile.depth || tile.list.feature_count ? forward_tile<true>(tile) : forward_tile<false>(tile);
}

inline std::uint32_t backward(const BackwardTile& tile) {
  return tile.depth || tile.list.feature_count || tile.absolute || tile.squared ? backward_tile<true>(tile)
                                                                                : backward_tile<false>(tile);
}

inline constexpr Kernels kKernels = {
    AA4D_ARCH_NAME, &project,     &touched_tiles,      &project_backward,    &forward,
    &backward,      &count_pairs, &forward_arithmetic, &backward_arithmetic,
};

}  // namespace aa4d::raster::AA4D_ARCH

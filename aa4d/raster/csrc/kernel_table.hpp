// The kernels of the instruction set that the including file is compiled for.
#pragma once

#include "arithmetic.hpp"
#include "blend_backward.hpp"
#include "blend_forward.hpp"
#include "projection.hpp"
#include "projection_backward.hpp"
#include "touched_tiles.hpp"

namespace aa4d::AA4D_ARCH {

inline void forward(const ForwardTile& tile) {
  tile.depth || tile.list.feature_count ? forward_tile<true>(tile) : forward_tile<false>(tile);
}

inline std::uint32_t backward(const BackwardTile& tile) {
  return tile.depth || tile.list.feature_count || tile.absolute ? backward_tile<true>(tile) : backward_tile<false>(tile);
}

inline constexpr Kernels kKernels = {
    AA4D_ARCH_NAME, &project,     &touched_tiles,   &project_backward,    &forward,
    &backward,      &count_pairs, &forward_arithmetic, &backward_arithmetic,
};

}  // namespace aa4d::AA4D_ARCH

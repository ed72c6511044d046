// The kernels of the instruction set that the including file is compiled for.
#pragma once

#include "blend_backward.hpp"
#include "blend_forward.hpp"

namespace aa4d::AA4D_ARCH {

inline std::uint32_t forward(const ForwardTile& tile) {
  return tile.depth ? forward_tile<true>(tile) : forward_tile<false>(tile);
}

inline void backward(const BackwardTile& tile) {
  tile.depth_gradient ? backward_tile<true>(tile) : backward_tile<false>(tile);
}

}  // namespace aa4d::AA4D_ARCH

// Which Gaussians each tile draws, near to far.
#pragma once

#include "raster/frame.hpp"

namespace aa4d::raster {

// The tiles that each Gaussian of a chunk, [begin, end), touches. One that touches none is no longer seen: its radius
// becomes zero.
void find_tiles(Frame& frame, std::size_t begin, std::size_t end, std::int32_t* radii);

// Fills tile_begin and entries from what find_tiles() found.
void sort_into_tiles(Frame& frame, int threads);

}  // namespace aa4d::raster

// Lists of Gaussians for the tiles, near to far.
#pragma once

#include "frame.hpp"

namespace aa4d {

// Needs frame.splats, boxes and depth_keys. Fills frame.slots, tile_begin and entries, and clears the radius of a
// Gaussian whose box touches the image but whose ellipse does not.
void sort_into_tiles(Frame& frame, std::int32_t* radii, int threads);

}  // namespace aa4d

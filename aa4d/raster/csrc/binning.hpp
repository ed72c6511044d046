// Lists of Gaussians for the tiles, near to far.
#pragma once

#include "frame.hpp"

namespace aa4d {

// Needs what project() leaves in the frame; fills frame.tile_begin and frame.entries.
void sort_into_tiles(Frame& frame, int threads);

}  // namespace aa4d

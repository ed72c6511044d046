// From a Gaussian in space to an ellipse on the screen (EWA splatting, Zwicker et al. 2002), and back with gradients.
#pragma once

#include "frame.hpp"

namespace aa4d {

// Where the gradients of the inputs go; laid out like the inputs.
struct SceneGradient {
  float* means;
  float* quaternions;
  float* scales;
  float* opacities;
  float* colors;
  float* screen;  // [N] norm of the gradient of the centre, in normalised device units
};

// Projects everything, fills frame.splats, frame.depth_keys, frame.slot_begin and frame.chunk_tiles. `radii` [N]: zero
// for what cannot be seen.
void project(const Scene& scene, Frame& frame, double min_alpha, std::int32_t* radii, int threads);

// Sums frame.gradients over each Gaussian's tiles and carries them through the projection.
void project_backward(const Scene& scene, const Frame& frame, const SceneGradient& gradient, int threads);

}  // namespace aa4d

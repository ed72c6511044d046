// What one rendering keeps for its backward pass. Frames are pooled: their buffers are used again by later renderings.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "buffer.hpp"
#include "constants.hpp"

namespace aa4d {

struct CameraModel {
  double rotation[9];  // world to camera, row by row
  double translation[3];
  double fx, fy, cx, cy;
  double near;
  int width, height;
};

// What the user passes, as plain arrays.
struct Scene {
  std::size_t count = 0;
  const float* means = nullptr;
  const float* quaternions = nullptr;
  const float* scales = nullptr;
  const float* opacities = nullptr;
  const float* colors = nullptr;
};

// A projected Gaussian, in one cache line. With (dx, dy) from its centre to a pixel's centre,
//   u = l11 dx + l21 dy,  w = l22 dy,  alpha = 2^(log2_opacity - u^2 - w^2):
// L is the Cholesky factor of the inverse covariance, scaled so that the exponent is in powers of two. In this form a
// long needle loses no digits to cancellation, which the quadratic in (dx, dy) does; the double part is reduced to the
// tile's origin before it becomes float.
struct alignas(64) Splat {
  double x, y;
  double l11, l21, l22;
  float log2_opacity;
  float color[3];
  float depth;
  float reach;  // u^2 + w^2 at which alpha falls to the cut-off
};
static_assert(sizeof(Splat) == 64);

// The gradient sums of one Gaussian over the pixels of one tile.
struct alignas(64) SplatGradient {
  float color[3];
  float v;                // sum of dL/d(ln alpha)
  float vu, vw;           // its first moments in (u, w)
  float vuu, vuw, vww;    // and the second ones
  float depth;
  float unused[6];
};
static_assert(sizeof(SplatGradient) == 64);

// A Gaussian in the depth-ordered list of a tile; `slot` is the place of this pair's gradient.
struct TileEntry {
  std::uint32_t gaussian;
  std::uint32_t slot;
};

// Gaussians are projected in chunks of this size, whatever the number of threads.
inline constexpr std::size_t kProjectionChunk = 1024;

struct Frame {
  CameraModel camera;
  std::size_t count = 0;
  int tiles_x = 0, tiles_y = 0;
  bool with_depth = false;

  Buffer<Splat> splats;                  // [N]
  Buffer<std::uint32_t> depth_keys;      // [N]
  Buffer<std::uint32_t> slot_begin;      // [N + 1]: the slots of Gaussian g are [slot_begin[g], slot_begin[g + 1])
  Buffer<std::uint32_t> tile_begin;      // [tiles + 1]
  Buffer<TileEntry> entries;             // [pairs of a tile and a Gaussian], tile by tile, near to far
  Buffer<float> transmittance;           // [tiles * 256], block by block; what is left behind the last contribution
  Buffer<std::int32_t> stop;             // [tiles * 256]: the place in the tile's list at which the pixel was finished
  Buffer<std::uint32_t> tile_end;        // [tiles]: how much of the tile's list was looked at

  // Scratch.
  std::vector<Buffer<std::uint32_t>> chunk_tiles;  // per chunk of Gaussians: the tiles they touch, one after another
  Buffer<std::uint32_t> order, order_other;
  Buffer<std::uint32_t> cursor;
  Buffer<SplatGradient> gradients;       // [slots]
  Buffer<double> background_gradient;    // [tiles * 3]

  int tiles() const { return tiles_x * tiles_y; }
};

struct ReturnToPool {
  void operator()(Frame* frame) const;
};
using FramePtr = std::unique_ptr<Frame, ReturnToPool>;

FramePtr acquire_frame();

}  // namespace aa4d

// What one rendering keeps for its backward pass. Frames are pooled: their buffers are used again by later renderings.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "common/buffer.hpp"
#include "raster/constants.hpp"
#include "raster/scene.hpp"

namespace aa4d::raster {

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

// The tiles that the box around a splat's ellipse touches: columns [x_begin, x_end), rows likewise.
struct TileBox {
  std::uint16_t x_begin, x_end, y_begin, y_end;
};

// The gradient sums of one Gaussian over the pixels of one tile, v being dL/d(ln alpha).
struct alignas(64) SplatGradient {
  float color[3];
  float v, vu, vw, vuu, vuw, vww;       // moments of v in the splat's (u, w) frame
  float depth;
  float absolute_vu, absolute_vy;       // sums of |v u| and of |v (l21 u + l22 w)|
  float squared;                        // sum of (dL/d(alpha))^2
  float unused[3];
};
static_assert(sizeof(SplatGradient) == 64);

// A Gaussian in the depth-ordered list of a tile.
struct TileEntry {
  std::uint32_t gaussian;
  std::uint32_t slot;  // the place of this pair's gradient
};
inline constexpr std::size_t kMaxGaussians = std::size_t{1} << 28;

// The slots of one Gaussian.
struct SlotRange {
  std::uint32_t begin, end;
};

// Gaussians are worked on in chunks of this size, whatever the number of threads: sums over chunks keep their order.
inline constexpr std::size_t kChunk = 1024;

struct Frame {
  CameraModel camera;
  std::size_t count = 0;
  int tiles_x = 0, tiles_y = 0;

  Buffer<Splat> splats;               // [N]
  Buffer<SlotRange> slots;            // [N]
  Buffer<std::uint32_t> tile_begin;   // [tiles + 1]
  Buffer<TileEntry> entries;          // [slots], tile by tile, near to far
  Buffer<std::uint64_t> blocks;       // [slots] of each entry, one bit for each block of its tile that it may add to
  // [tiles * 1024], block by block:
  Buffer<float> transmittance;        // behind the last contribution
  Buffer<std::int32_t> pixel_end;     // one past the place in the tile's list of the last contribution
  Buffer<float> weight;               // sum of the weights; filled when depth was asked for

  // Scratch, of no use once the call that filled it has returned.
  Buffer<TileBox> boxes;           // [N]
  Buffer<std::uint32_t> depth_keys;   // [N] bits of the depth, zero for what is not seen
  Buffer<std::uint64_t> order, order_other;  // seen Gaussians near to far: depth in the upper, index in the lower half
  std::vector<Buffer<std::uint32_t>> touched;  // per chunk: the tiles that its Gaussians touch, one after another
  Buffer<std::uint32_t> chunk_slots;  // each chunk's first slot
  Buffer<std::uint32_t> slot_tiles;  // [slots] all chunks' touched tiles
  Buffer<std::uint32_t> histogram;  // of digits while sorting, then of tiles, for each part of the order
  Buffer<SplatGradient> gradients;  // [slots]
  Buffer<float> feature_gradients;  // [slots, F]
  Buffer<double> partial_sums;  // per tile or chunk

  int tiles() const { return tiles_x * tiles_y; }
  std::size_t chunks() const { return (count + kChunk - 1) / kChunk; }
};

struct ReturnToPool {
  void operator()(Frame* frame) const;
};
using FramePtr = std::unique_ptr<Frame, ReturnToPool>;

FramePtr acquire_frame();

}  // namespace aa4d::raster

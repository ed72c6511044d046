// What the kernels of one instruction set offer, and the plain data they work on. A tile's pixels are stored block by
// block (4x4 pixels, row by row within a block), so that one register holds one block.
#pragma once

#include <cstdint>

#include "frame.hpp"

namespace aa4d {

struct TileList {
  const Splat* splats;
  const TileEntry* entries;  // near to far
  std::uint32_t count;
  int x, y;  // the tile's first pixel
};

struct ForwardTile {
  TileList list;
  int pixels_x, pixels_y;         // how much of the tile lies inside the image
  float log2_min_alpha, min_transmittance;
  // [256] each. Transmittance comes in as one and is negative where the pixel was finished early.
  float* transmittance;
  std::int32_t* stop;
  float* color[3];
  float* depth;                   // sum of w z; null when it is not wanted
};

struct BackwardTile {
  TileList list;
  float log2_min_alpha;
  const std::int32_t* stop;       // [256] each
  const float* color_gradient[3];
  const float* depth_gradient;    // dL/d(sum of w z); null when there is none
  float* transmittance;           // in: behind the last contribution
  float* behind;                  // in: dL/d(ln transmittance) of what lies behind
  SplatGradient* gradients;       // by slot
};

struct Kernels {
  const char* name;
  std::uint32_t (*forward_tile)(const ForwardTile&);  // returns how much of the list was looked at
  void (*backward_tile)(const BackwardTile&);
};

extern const Kernels kPortableKernels;
#if defined(__x86_64__)
extern const Kernels kAvx2Kernels, kAvx512Kernels;
#endif

// The best set this machine can run, unless AA4D_SIMD names another one (avx512, avx2, portable).
const Kernels& kernels();

}  // namespace aa4d

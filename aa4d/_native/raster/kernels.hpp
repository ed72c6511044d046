// What the kernels of one instruction set offer, and the plain data they work on. A tile's pixels are stored block by
// block (4x4 pixels, row by row within a block), so that one AVX-512 register holds one block.
#pragma once

#include <cstdint>

#include "raster/frame.hpp"

namespace aa4d::raster {

struct TileList {
  const Splat* splats;
  const TileEntry* entries;  // near to far
  std::uint64_t* blocks;     // of each entry; the forward pass finds them
  std::uint32_t count;
  int x, y;  // the tile's first pixel
  const float* features;     // [N, F] or null
  int feature_count;
};

// Planes have kTilePixels floats; those of features follow one another.
struct ForwardTile {
  TileList list;
  int pixels_x, pixels_y;      // how much of the tile lies inside the image
  float log2_min_alpha, min_transmittance;
  float* transmittance;        // in: one (zero outside the image); out: what is left behind the last contribution
  std::int32_t* pixel_end;     // in: zero; out: one past the place of the last contribution
  float* color[3];             // in: zero, as all that follow
  float* depth;                // sum of w z; null when it is not wanted
  float* weight;               // sum of w; null when depth is
  float* features;             // [F] planes
};

struct BackwardTile {
  TileList list;
  float log2_min_alpha;
  const std::int32_t* pixel_end;
  const float* color[3];       // dL/d(sum of w c)
  const float* depth;          // dL/d(sum of w (z - depth_value)); null when there is none
  const float* depth_value;    // the depth that was rendered
  const float* features;       // [F] planes
  float* transmittance;        // in: behind the last contribution
  float* behind;               // in: dL/d(ln transmittance) of what lies behind everything
  bool absolute;               // whether SplatGradient's absolute sums are wanted
  bool squared;                // whether its sum of squares is
  SplatGradient* gradients;    // by slot
  float* feature_gradients;    // [slots, F]
};

// A run of Gaussians to project.
struct ProjectionRange {
  const Scene* scene;
  const CameraModel* camera;
  const Settings* settings;
  std::size_t begin, end;
};

inline constexpr int kPoseSums = 12;  // dL/d(rotation) row by row, dL/d(translation)

struct Kernels {
  const char* name;
  // Fills splats, boxes and depth_keys of the range, and radii; false if a Gaussian is not finite, which leaves it out.
  bool (*project)(const ProjectionRange&, Frame& frame, std::int32_t* radii);
  // The tiles of a group of 4x4, whose first one is given, that a splat touches: one bit each, row by row.
  std::uint32_t (*touched_tiles)(const Splat&, const CameraModel&, int column, int row);
  // Sums gradients over each Gaussian's slots and carries them to the inputs; `pose` [kPoseSums] may be null.
  void (*project_backward)(const ProjectionRange&, const Frame&, const SceneGradient&, double* pose);
  void (*forward_tile)(const ForwardTile&);
  std::uint32_t (*backward_tile)(const BackwardTile&);  // returns the place in the list from which on nothing was added
  // For the benchmark: the contributions of a tile that was rendered before, and the pure arithmetic of contributions.
  std::uint64_t (*count_pairs)(const BackwardTile&);
  float (*forward_arithmetic)(std::uint64_t pairs);
  float (*backward_arithmetic)(std::uint64_t pairs);
};

extern const Kernels kPortableKernels;
#if defined(__x86_64__)
extern const Kernels kAvx2Kernels, kAvx512Kernels;
#endif

// The best set this machine can run, unless the environment's AA4D_SIMD names another (avx512, avx2, portable).
const Kernels& kernels();

}  // namespace aa4d::raster

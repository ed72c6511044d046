// A splat as the pixels of one tile see it: what the blending of a pair reads, in single precision and in one cache
// line.
#pragma once

#include "raster/grid.hpp"
#include "raster/kernels.hpp"

namespace aa4d::raster::AA4D_ARCH {

struct alignas(64) SplatView {
  float l11, l21, l22;  // see Splat
  float u0, w0;         // of the tile's centre
  float log2_opacity, color[3], depth;
  std::uint32_t gaussian;

  void look(const TileList& list, std::int64_t place) {
    gaussian = list.entries[place].gaussian;
    const Splat& splat = list.splats[gaussian];
    // The centre is the origin because it is the nearest point to all pixels: that keeps the most digits.
    const double dx = list.x + kTileSize / 2 - splat.x, dy = list.y + kTileSize / 2 - splat.y;
    l11 = static_cast<float>(splat.l11);
    l21 = static_cast<float>(splat.l21);
    l22 = static_cast<float>(splat.l22);
    u0 = static_cast<float>(splat.l11 * dx + splat.l21 * dy);
    w0 = static_cast<float>(splat.l22 * dy);
    log2_opacity = splat.log2_opacity;
    depth = splat.depth;
    for (int k = 0; k < 3; ++k) color[k] = splat.color[k];
  }

  // Of the pixels at (x, y) from the tile's centre.
  Float u(Float x, Float y) const { return fma(Float(l11), x, fma(Float(l21), y, Float(u0))); }
  Float w(Float y) const { return fma(Float(l22), y, Float(w0)); }

  // log2 of alpha, before the clamp.
  Float log2_alpha(Float u, Float w) const { return fnma(w, w, fnma(u, u, Float(log2_opacity))); }
};

}  // namespace aa4d::raster::AA4D_ARCH

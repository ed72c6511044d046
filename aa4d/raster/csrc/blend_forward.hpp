// Front-to-back alpha blending of one tile.
#pragma once

#include "block_map.hpp"

namespace aa4d::AA4D_ARCH {

template <bool kWithDepth>
std::uint32_t forward_tile(const ForwardTile& tile) {
  constexpr int kPrefetch = 8;  // entries ahead: the lists point all over the splats
  const TileList& list = tile.list;
  const Float cutoff(tile.log2_min_alpha), max_alpha(static_cast<float>(kMaxAlpha)), zero(0.0f);
  const Float min_transmittance(tile.min_transmittance);

  std::uint32_t alive = 0;  // blocks with a pixel inside the image that is not finished
  for (int b = 0; b < kTileBlocks; ++b) {
    const bool inside = kGrid.x.lane[b] < tile.pixels_x && kGrid.y.lane[b] < tile.pixels_y;
    alive |= static_cast<std::uint32_t>(inside) << b;
  }

  std::uint32_t i = 0;
  for (; i < list.count && alive != 0; ++i) {
    if (i + kPrefetch < list.count) __builtin_prefetch(&list.splats[list.entries[i + kPrefetch].gaussian]);
    const Splat& splat = list.splats[list.entries[i].gaussian];
    BlockMap map;
    map.build(splat, list.x, list.y);

    const Float l11(static_cast<float>(splat.l11)), l21(static_cast<float>(splat.l21));
    const Float l22(static_cast<float>(splat.l22));
    const Float log2_opacity(splat.log2_opacity), depth(splat.depth);
    const Float red(splat.color[0]), green(splat.color[1]), blue(splat.color[2]);
    Float u_pixel[kBlockVectors], w_pixel[kBlockVectors];
    for (int k = 0; k < kBlockVectors; ++k) {
      const Float px = Float::load(kGrid.px.lane + k * Float::kWidth), py = Float::load(kGrid.py.lane + k * Float::kWidth);
      u_pixel[k] = fma(l11, px, l21 * py);
      w_pixel[k] = l22 * py;
    }

    for (std::uint32_t todo = map.reached & alive; todo != 0; todo &= todo - 1) {
      const int block = __builtin_ctz(todo);
      const Float u_block(map.u.lane[block]), w_block(map.w.lane[block]);
      bool finished_some = false;
      for (int k = 0; k < kBlockVectors; ++k) {
        const int p = block * kBlockPixels + k * Float::kWidth;
        const Float u = u_pixel[k] + u_block, w = w_pixel[k] + w_block;
        const Float exponent = fnma(w, w, fnma(u, u, log2_opacity));
        const Float alpha = min(exp2_nonpositive(exponent), max_alpha);
        const Float before = Float::load(tile.transmittance + p);
        const Float after = fnma(alpha, before, before);
        const Mask passes = (exponent >= cutoff) & (before > zero);
        const Mask finishes = passes & (after <= min_transmittance);
        const Mask adds = and_not(passes, finishes);
        const Float weight = zero_unless(adds, alpha * before);
        fma(weight, red, Float::load(tile.color[0] + p)).store(tile.color[0] + p);
        fma(weight, green, Float::load(tile.color[1] + p)).store(tile.color[1] + p);
        fma(weight, blue, Float::load(tile.color[2] + p)).store(tile.color[2] + p);
        if constexpr (kWithDepth) fma(weight, depth, Float::load(tile.depth + p)).store(tile.depth + p);
        Float transmittance = select(adds, after, before);
        if (any(finishes)) {
          transmittance = select(finishes, negate(before), transmittance);
          store_where(finishes, tile.stop + p, static_cast<std::int32_t>(i));
          finished_some = true;
        }
        transmittance.store(tile.transmittance + p);
      }
      if (finished_some) {
        bool any_left = false;
        for (int k = 0; k < kBlockVectors; ++k) {
          any_left |= any(Float::load(tile.transmittance + block * kBlockPixels + k * Float::kWidth) > zero);
        }
        if (!any_left) alive &= ~(1u << block);
      }
    }
  }
  return i;
}

}  // namespace aa4d::AA4D_ARCH

// Front-to-back alpha blending of one tile.
#pragma once

#include "splat_in_tile.hpp"

namespace aa4d::AA4D_ARCH {

inline constexpr std::uint32_t kPrefetch = 8;  // entries ahead: a tile's list points all over the splats

inline std::uint32_t blocks_inside(int pixels_x, int pixels_y) {
  std::uint32_t result = 0;
  for (int b = 0; b < kTileBlocks; ++b) {
    const bool inside = kGrid.x.lane[b] < pixels_x && kGrid.y.lane[b] < pixels_y;
    result |= static_cast<std::uint32_t>(inside) << b;
  }
  return result;
}

inline void accumulate(float* sums, Float weight, Float value) { fma(weight, value, Float::load(sums)).store(sums); }

// kExtras: whether depth or features are wanted beside colour.
template <bool kExtras>
std::uint32_t forward_tile(const ForwardTile& tile) {
  const TileList& list = tile.list;
  const Float cutoff(tile.log2_min_alpha), max_alpha(static_cast<float>(kMaxAlpha)), zero(0.0f), one(1.0f);
  const Float min_transmittance(tile.min_transmittance);
  std::uint32_t alive = blocks_inside(tile.pixels_x, tile.pixels_y);  // blocks with an unfinished pixel

  std::uint32_t i = 0;
  for (; i < list.count && alive != 0; ++i) {
    if (i + kPrefetch < list.count) __builtin_prefetch(&list.splats[list.entries[i + kPrefetch].gaussian]);
    const std::size_t gaussian = list.entries[i].gaussian;
    const Splat& splat = list.splats[gaussian];
    const SplatInTile seen(splat, list.x, list.y);
    const Float red(splat.color[0]), green(splat.color[1]), blue(splat.color[2]), depth(splat.depth);

    for (std::uint32_t todo = seen.reached() & alive; todo != 0; todo &= todo - 1) {
      const int block = __builtin_ctz(todo);
      bool finished_some = false;
      for (int k = 0; k < kBlockVectors; ++k) {
        const int p = block * kBlockPixels + k * Float::kWidth;
        const Float exponent = seen.log2_alpha(seen.u(block, k), seen.w(block, k));
        const Float alpha = min(exp2_nonpositive(exponent), max_alpha);
        const Float before = Float::load(tile.transmittance + p);
        const Float weight_if = alpha * before, after = before - weight_if;
        const Mask passes = (exponent >= cutoff) & (before > zero);
        const Mask finishes = passes & (after <= min_transmittance);
        const Mask adds = and_not(passes, finishes);
        const Float weight = zero_unless(adds, weight_if);
        accumulate(tile.color[0] + p, weight, red);
        accumulate(tile.color[1] + p, weight, green);
        accumulate(tile.color[2] + p, weight, blue);
        if constexpr (kExtras) {
          if (tile.depth) {
            accumulate(tile.depth + p, weight, depth);
            accumulate(tile.weight + p, weight, one);
          }
          for (int c = 0; c < list.feature_count; ++c) {
            accumulate(tile.features + c * kTilePixels + p, weight, Float(list.features[gaussian * list.feature_count + c]));
          }
        }
        Float transmittance = before - weight;
        if (any(finishes)) {
          transmittance = select(finishes, negate(before), transmittance);
          store_where(finishes, tile.stop + p, static_cast<std::int32_t>(i));
          finished_some = true;
        }
        transmittance.store(tile.transmittance + p);
      }
      if (finished_some) {
        bool any_left = false;
        for (int p = block * kBlockPixels; p < (block + 1) * kBlockPixels; p += Float::kWidth) {
          any_left |= any(Float::load(tile.transmittance + p) > zero);
        }
        if (!any_left) alive &= ~(1u << block);
      }
    }
  }
  return i;
}

}  // namespace aa4d::AA4D_ARCH

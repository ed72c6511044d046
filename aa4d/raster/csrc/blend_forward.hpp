// Front-to-back alpha blending of one tile.
#pragma once

#include "batch.hpp"

namespace aa4d::AA4D_ARCH {

// One bit for each block that has a pixel inside the image.
inline std::uint64_t blocks_inside(int pixels_x, int pixels_y) {
  std::uint64_t result = 0;
  for (int b = 0; b < kTileBlocks; ++b) {
    const int quarter = b / kQuarterBlocks;
    const float x = kGrid.block_x[b % kQuarterBlocks] + quarter % 2 * kQuarterSize;
    const float y = kGrid.block_y[b % kQuarterBlocks] + quarter / 2 * kQuarterSize;
    result |= static_cast<std::uint64_t>(x < pixels_x && y < pixels_y) << b;
  }
  return result;
}

// The blocks that have an unfinished pixel.
struct AliveBlocks {
  std::uint64_t bits;

  std::uint32_t of(int quarter) const {
    return static_cast<std::uint32_t>(bits >> (quarter * kQuarterBlocks)) & ((1u << kQuarterBlocks) - 1);
  }
  bool any(const TileEntry& entry, int quarter, std::int64_t) const {
    return (entry.quarters >> quarter & 1) & (of(quarter) != 0);
  }
  // Finds them, and notes them for the way back.
  std::uint32_t blocks(TileEntry& entry, int quarter, std::int64_t, const Splat& splat, int x, int y) const {
    const std::uint32_t result = reached_blocks(splat, x, y) & of(quarter);
    entry.blocks[quarter] = static_cast<std::uint16_t>(result);
    return result;
  }
};

inline void accumulate(float* sums, Float weight, Float value) { fma(weight, value, Float::load(sums)).store(sums); }

// kExtras: whether depth or features are wanted beside colour.
template <bool kExtras>
void forward_tile(const ForwardTile& tile) {
  const TileList& list = tile.list;
  const Float cutoff(tile.log2_min_alpha), max_alpha(static_cast<float>(kMaxAlpha)), zero(0.0f), one(1.0f);
  const Float min_transmittance(tile.min_transmittance);
  AliveBlocks alive = {blocks_inside(tile.pixels_x, tile.pixels_y)};
  // Copies, because the compiler must assume that a store of pixels changes what the tile points to.
  float *const transmittances = tile.transmittance, *const reds = tile.color[0], *const greens = tile.color[1];
  float* const blues = tile.color[2];
  std::int32_t* const pixel_ends = tile.pixel_end;
  Batch batch;
  Batch::prefetch_first(list, 0, 1, list.count);

  for (std::int64_t done = 0; done < list.count && alive.bits != 0;) {
    const int taken = batch.fill(list, done, 1, list.count - done, alive);
    for (const BlockItem* item = batch.begin(); item != batch.end(); ++item) {
      const QuarterView& view = batch.view(*item);
      for (int k = 0; k < kBlockPixels; k += Float::kWidth) {
        const int p = item->block() * kBlockPixels + k;
        const Float exponent = view.log2_alpha(view.u(item->quarter_block(), k), view.w(item->quarter_block(), k));
        const Float alpha = min(exp2_nonpositive(exponent), max_alpha);
        const Float before = Float::load(transmittances + p);
        const Float weight_if = alpha * before;
        // A finished pixel's transmittance is negative, which fails the second test too.
        const Mask passes = exponent >= cutoff, adds = passes & (before - weight_if > min_transmittance);
        const Float weight = zero_unless(adds, weight_if);
        negative_where(and_not(passes, adds), before - weight).store(transmittances + p);
        store_where(adds, pixel_ends + p, view.place + 1);
        accumulate(reds + p, weight, Float(view.color[0]));
        accumulate(greens + p, weight, Float(view.color[1]));
        accumulate(blues + p, weight, Float(view.color[2]));
        if constexpr (kExtras) {
          if (tile.depth) {
            accumulate(tile.depth + p, weight, Float(view.depth));
            accumulate(tile.weight + p, weight, one);
          }
          const float* const features = list.features + std::size_t{view.gaussian} * list.feature_count;
          for (int c = 0; c < list.feature_count; ++c) {
            accumulate(tile.features + c * kTilePixels + p, weight, Float(features[c]));
          }
        }
      }
    }
    done += taken;
    for (std::uint64_t rest = alive.bits; rest != 0; rest &= rest - 1) {
      const int block = __builtin_ctzll(rest);
      bool any_left = false;
      for (int k = 0; k < kBlockPixels; k += Float::kWidth) {
        any_left |= any(Float::load(transmittances + block * kBlockPixels + k) > zero);
      }
      alive.bits &= ~(static_cast<std::uint64_t>(!any_left) << block);
    }
  }
}

}  // namespace aa4d::AA4D_ARCH

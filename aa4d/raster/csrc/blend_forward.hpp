// Front-to-back alpha blending of one tile.
#pragma once

#include "batch.hpp"

namespace aa4d::AA4D_ARCH {

// One bit for each block that has a pixel inside the image.
inline std::uint64_t blocks_inside(int pixels_x, int pixels_y) {
  std::uint64_t result = 0;
  for (int b = 0; b < kTileBlocks; ++b) {
    const int quarter = b / kQuarterBlocks;
    const float x = kGrid.x[b % kQuarterBlocks] + quarter % 2 * kQuarterSize;
    const float y = kGrid.y[b % kQuarterBlocks] + quarter / 2 * kQuarterSize;
    result |= static_cast<std::uint64_t>(x < pixels_x && y < pixels_y) << b;
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
  std::uint64_t alive = blocks_inside(tile.pixels_x, tile.pixels_y);  // blocks with an unfinished pixel
  const auto wanted = [&](int quarter, std::int64_t) {
    return static_cast<std::uint32_t>(alive >> (quarter * kQuarterBlocks)) & ((1u << kQuarterBlocks) - 1);
  };
  Batch batch;

  std::uint32_t done = 0;
  while (done < list.count && alive != 0) {
    const int taken = batch.fill(list, done, 1, list.count - done, wanted);
    for (const BlockItem* item = batch.items_begin(); item != batch.items_end(); ++item) {
      const QuarterView& view = batch.view(item->view());
      const int first = item->block() * kBlockPixels;
      bool finished_some = false;
      for (int k = 0; k < kBlockPixels; k += Float::kWidth) {
        const int p = first + k;
        const Float exponent = view.log2_alpha(view.u(item->quarter_block(), k), view.w(item->quarter_block(), k));
        const Float alpha = min(exp2_nonpositive(exponent), max_alpha);
        const Float before = Float::load(tile.transmittance + p);
        const Float weight_if = alpha * before, after = before - weight_if;
        const Mask passes = (exponent >= cutoff) & (before > zero);
        const Mask finishes = passes & (after <= min_transmittance);
        const Float weight = zero_unless(and_not(passes, finishes), weight_if);
        accumulate(tile.color[0] + p, weight, Float(view.color[0]));
        accumulate(tile.color[1] + p, weight, Float(view.color[1]));
        accumulate(tile.color[2] + p, weight, Float(view.color[2]));
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
        Float transmittance = before - weight;
        if (any(finishes)) {
          transmittance = select(finishes, negate(before), transmittance);
          store_where(finishes, tile.stop + p, static_cast<std::int32_t>(done + batch.entry_of(item->view())));
          finished_some = true;
        }
        transmittance.store(tile.transmittance + p);
      }
      if (finished_some) {
        bool any_left = false;
        for (int p = first; p < first + kBlockPixels; p += Float::kWidth) {
          any_left |= any(Float::load(tile.transmittance + p) > zero);
        }
        if (!any_left) alive &= ~(std::uint64_t{1} << item->block());
      }
    }
    done += taken;
  }
  return done;
}

}  // namespace aa4d::AA4D_ARCH

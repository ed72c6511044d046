// The gradient of one tile's blending, from its farthest contribution to its nearest.
//
// With g the gradient of the pixel, c.g the inner product of a Gaussian's colour with it, T the transmittance in front
// of the Gaussian and S the sum of w c.g over everything behind it (background and alpha included):
//   dL/d(alpha) = T c.g - S / (1 - alpha).
// Walking back, T is regained by dividing by 1 - alpha >= 0.01 and S by adding what each Gaussian gave: neither
// cancels.
#pragma once

#include "raster/blend_forward.hpp"

namespace aa4d::raster::AA4D_ARCH {

// A run of a tile's list, from a place towards the viewer, and the blocks that each of it adds to.
class BackwardBatch {
 public:
  explicit BackwardBatch(const BackwardTile& tile) : list_(tile.list) {
    for (int b = 0; b < kTileBlocks; ++b) {
      std::int32_t end = 0;
      for (int p = b * kBlockPixels; p < (b + 1) * kBlockPixels; ++p) {
        end = tile.pixel_end[p] > end ? tile.pixel_end[p] : end;
      }
      block_end_[b] = end;
      last_ = end > last_ ? end : last_;
    }
    for (std::int32_t i = 0; i < kPrefetch && i < last_; ++i) prefetch(last_ - 1 - i);
  }

  // One past the place of the tile's last contribution.
  std::int32_t last() const { return last_; }

  // Takes entries from the one before `end` on. Returns how many.
  int fill(std::int32_t end) {
    const int taken = end < kSplats ? end : kSplats;
    int items = 0;
    for (int e = 0; e < taken; ++e) {
      const std::int32_t place = end - 1 - e;
      if (place >= kPrefetch) prefetch(place - kPrefetch);
      views_[e].look(list_, place);
      // Those that the forward pass found, as far as they have contributions at or behind this place.
      std::uint64_t open = 0;
      for (int i = 0; i < kTileBlocks; i += Float::kWidth) {
        open |= static_cast<std::uint64_t>(bits(above(block_end_ + i, place))) << i;
      }
      const std::uint64_t blocks = list_.blocks[place] & open;
      for (int i = 0; i < kTileBlocks; i += 16) {
        items += append_lanes(static_cast<std::uint32_t>(blocks >> i) & 0xffff, i, blocks_ + items);
      }
      ends_[e + 1] = items;
    }
    return taken;
  }

  const SplatView& view(int e) const { return views_[e]; }
  const std::uint32_t* begin(int e) const { return blocks_ + ends_[e]; }
  const std::uint32_t* end(int e) const { return blocks_ + ends_[e + 1]; }

 private:
  static constexpr int kSplats = 32;
  static constexpr std::int32_t kPrefetch = 48;  // entries ahead: a tile's list points all over the splats

  void prefetch(std::int32_t place) const { __builtin_prefetch(&list_.splats[list_.entries[place].gaussian]); }

  const TileList list_;
  alignas(64) std::int32_t block_end_[kTileBlocks];  // nothing from that place on concerns the block
  std::int32_t last_ = 0;
  SplatView views_[kSplats];
  std::uint32_t blocks_[kSplats * kTileBlocks + 16];  // with room for the appending store
  int ends_[kSplats + 1] = {};
};

// kExtras: whether there is more than the gradient of colour: depth, features, absolute or squared sums.
template <bool kExtras>
std::uint32_t backward_tile(const BackwardTile& tile) {
  const TileList& list = tile.list;
  const Float cutoff(tile.log2_min_alpha), max_alpha(static_cast<float>(kMaxAlpha)), one(1.0f), zero(0.0f);
  alignas(64) float sum_features[kExtras ? kMaxFeatures : 1][Float::kWidth];
  // Copies, because the compiler must assume that a store of pixels changes what the tile points to.
  const float *const g_reds = tile.color[0], *const g_greens = tile.color[1], *const g_blues = tile.color[2];
  float *const transmittances = tile.transmittance, *const behinds = tile.behind;
  const std::int32_t* const pixel_ends = tile.pixel_end;
  BackwardBatch batch(tile);

  for (std::int32_t left = batch.last(); left > 0;) {
    const int taken = batch.fill(left);
    for (int e = 0; e < taken; ++e) {
      const SplatView& view = batch.view(e);
      const std::int32_t place = left - 1 - e;
      const std::size_t slot = list.entries[place].slot;
      Float sum_red = zero, sum_green = zero, sum_blue = zero, sum_depth = zero;
      Float sum_v = zero, sum_vu = zero, sum_vw = zero, sum_vuu = zero, sum_vuw = zero, sum_vww = zero;
      Float sum_absolute_vu = zero, sum_absolute_vy = zero, sum_squared = zero;
      if constexpr (kExtras) {
        for (int c = 0; c < list.feature_count; ++c) zero.store(sum_features[c]);
      }

      for (const std::uint32_t* block = batch.begin(e); block != batch.end(e); ++block) {
        for (int k = 0; k < kBlockPixels; k += Float::kWidth) {
          const int p = static_cast<int>(*block) * kBlockPixels + k;
          const Float y = Float::load(kGrid.pixel_y + p), u = view.u(Float::load(kGrid.pixel_x + p), y), w = view.w(y);
          const Float exponent = view.log2_alpha(u, w);
          const Float unclamped = exp2_nonpositive(exponent);
          const Mask adds = (exponent >= cutoff) & above(pixel_ends + p, place);
          const Float alpha = zero_unless(adds, min(unclamped, max_alpha));

          const Float inverse = reciprocal(one - alpha);
          const Float before = Float::load(transmittances + p) * inverse;
          before.store(transmittances + p);
          const Float weight = alpha * before;

          const Float g_red = Float::load(g_reds + p), g_green = Float::load(g_greens + p);
          const Float g_blue = Float::load(g_blues + p);
          Float cg = Float(view.color[0]) * g_red;
          cg = fma(Float(view.color[1]), g_green, cg);
          cg = fma(Float(view.color[2]), g_blue, cg);
          sum_red = fma(weight, g_red, sum_red);
          sum_green = fma(weight, g_green, sum_green);
          sum_blue = fma(weight, g_blue, sum_blue);
          if constexpr (kExtras) {
            if (tile.depth) {
              const Float g_depth = Float::load(tile.depth + p);
              cg = fma(Float(view.depth) - Float::load(tile.depth_value + p), g_depth, cg);
              sum_depth = fma(weight, g_depth, sum_depth);
            }
            const float* const features = list.features + std::size_t{view.gaussian} * list.feature_count;
            for (int c = 0; c < list.feature_count; ++c) {
              const Float g_feature = Float::load(tile.features + c * kTilePixels + p);
              cg = fma(Float(features[c]), g_feature, cg);
              accumulate(sum_features[c], weight, g_feature);
            }
          }

          const Float behind = Float::load(behinds + p);
          const Float alpha_gradient = fnma(behind, inverse, before * cg);
          fma(weight, cg, behind).store(behinds + p);

          // v = dL/d(ln alpha); the clamp at kMaxAlpha passes no gradient.
          const Float v = zero_unless(unclamped <= max_alpha, alpha * alpha_gradient);
          const Float vu = v * u, vw = v * w;
          sum_v = sum_v + v;
          sum_vu = sum_vu + vu;
          sum_vw = sum_vw + vw;
          sum_vuu = fma(vu, u, sum_vuu);
          sum_vuw = fma(vu, w, sum_vuw);
          sum_vww = fma(vw, w, sum_vww);
          if constexpr (kExtras) {
            if (tile.absolute) {
              sum_absolute_vu = sum_absolute_vu + abs(vu);
              sum_absolute_vy = sum_absolute_vy + abs(fma(Float(view.l21), vu, Float(view.l22) * vw));
            }
            if (tile.squared) {
              const Float added = zero_unless(adds, alpha_gradient);
              sum_squared = fma(added, added, sum_squared);
            }
          }
        }
      }

      // In the order of SplatGradient's fields.
      const Float sums[12] = {sum_red, sum_green, sum_blue, sum_v,     sum_vu,          sum_vw,
                              sum_vuu, sum_vuw,   sum_vww,  sum_depth, sum_absolute_vu, sum_absolute_vy};
      sum_each(sums, reinterpret_cast<float*>(&tile.gradients[slot]));
      if constexpr (kExtras) {
        if (tile.squared) tile.gradients[slot].squared = sum(sum_squared);
        for (int c = 0; c < list.feature_count; ++c) {
          tile.feature_gradients[slot * list.feature_count + c] = sum(Float::load(sum_features[c]));
        }
      }
    }
    left -= taken;
  }
  return static_cast<std::uint32_t>(batch.last());
}

}  // namespace aa4d::raster::AA4D_ARCH

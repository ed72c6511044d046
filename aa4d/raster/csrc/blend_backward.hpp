// The gradient of one tile's blending, from its farthest contribution to its nearest.
//
// With g the gradient of the pixel, c.g the inner product of a Gaussian's colour with it, T the transmittance in front
// of the Gaussian and S the sum of w c.g over everything behind it (background and alpha included):
//   dL/d(alpha) = T c.g - S / (1 - alpha).
// Walking back, T is regained by dividing by 1 - alpha >= 0.01 and S by adding positive multiples: neither cancels.
#pragma once

#include "block_map.hpp"

namespace aa4d::AA4D_ARCH {

template <bool kWithDepth>
void backward_tile(const BackwardTile& tile) {
  constexpr std::uint32_t kPrefetch = 8;
  const TileList& list = tile.list;
  const Float cutoff(tile.log2_min_alpha), max_alpha(static_cast<float>(kMaxAlpha)), one(1.0f);

  std::int32_t block_stop[kTileBlocks];  // no pixel of the block takes anything from here on
  for (int b = 0; b < kTileBlocks; ++b) {
    block_stop[b] = 0;
    for (int p = b * kBlockPixels; p < (b + 1) * kBlockPixels; ++p) {
      if (tile.stop[p] > block_stop[b]) block_stop[b] = tile.stop[p];
    }
  }

  for (std::uint32_t i = list.count; i-- > 0;) {
    if (i >= kPrefetch) {
      __builtin_prefetch(&list.splats[list.entries[i - kPrefetch].gaussian]);
      __builtin_prefetch(&tile.gradients[list.entries[i - kPrefetch].slot], 1);
    }
    const Splat& splat = list.splats[list.entries[i].gaussian];
    BlockMap map;
    map.build(splat, list.x, list.y);

    const Float l11(static_cast<float>(splat.l11)), l21(static_cast<float>(splat.l21));
    const Float l22(static_cast<float>(splat.l22));
    const Float log2_opacity(splat.log2_opacity), depth(splat.depth);
    const Float red(splat.color[0]), green(splat.color[1]), blue(splat.color[2]);
    const Float zero(0.0f);
    Float sum_red = zero, sum_green = zero, sum_blue = zero, sum_depth = zero;
    Float sum_v = zero, sum_vu = zero, sum_vw = zero, sum_vuu = zero, sum_vuw = zero, sum_vww = zero;
    Float u_pixel[kBlockVectors], w_pixel[kBlockVectors];
    for (int k = 0; k < kBlockVectors; ++k) {
      const Float px = Float::load(kGrid.px.lane + k * Float::kWidth), py = Float::load(kGrid.py.lane + k * Float::kWidth);
      u_pixel[k] = fma(l11, px, l21 * py);
      w_pixel[k] = l22 * py;
    }

    for (std::uint32_t todo = map.reached; todo != 0; todo &= todo - 1) {
      const int block = __builtin_ctz(todo);
      if (block_stop[block] <= static_cast<std::int32_t>(i)) continue;
      const Float u_block(map.u.lane[block]), w_block(map.w.lane[block]);
      for (int k = 0; k < kBlockVectors; ++k) {
        const int p = block * kBlockPixels + k * Float::kWidth;
        const Float u = u_pixel[k] + u_block, w = w_pixel[k] + w_block;
        const Float exponent = fnma(w, w, fnma(u, u, log2_opacity));
        const Float unclamped = exp2_nonpositive(exponent);
        const Mask adds = (exponent >= cutoff) & above(tile.stop + p, static_cast<std::int32_t>(i));
        const Float alpha = zero_unless(adds, min(unclamped, max_alpha));

        const Float inverse = reciprocal(one - alpha);
        const Float before = Float::load(tile.transmittance + p) * inverse;
        before.store(tile.transmittance + p);
        const Float weight = alpha * before;

        const Float g_red = Float::load(tile.color_gradient[0] + p), g_green = Float::load(tile.color_gradient[1] + p);
        const Float g_blue = Float::load(tile.color_gradient[2] + p);
        Float cg = fma(blue, g_blue, fma(green, g_green, red * g_red));
        if constexpr (kWithDepth) {
          const Float g_depth = Float::load(tile.depth_gradient + p);
          cg = fma(depth, g_depth, cg);
          sum_depth = fma(weight, g_depth, sum_depth);
        }
        sum_red = fma(weight, g_red, sum_red);
        sum_green = fma(weight, g_green, sum_green);
        sum_blue = fma(weight, g_blue, sum_blue);

        const Float behind = Float::load(tile.behind + p);
        const Float alpha_gradient = fnma(behind, inverse, before * cg);
        fma(weight, cg, behind).store(tile.behind + p);

        // v = dL/d(ln alpha); the clamp at kMaxAlpha passes no gradient.
        const Float v = zero_unless(unclamped <= max_alpha, alpha * alpha_gradient);
        const Float vu = v * u, vw = v * w;
        sum_v = sum_v + v;
        sum_vu = sum_vu + vu;
        sum_vw = sum_vw + vw;
        sum_vuu = fma(vu, u, sum_vuu);
        sum_vuw = fma(vu, w, sum_vuw);
        sum_vww = fma(vw, w, sum_vww);
      }
    }

    SplatGradient& out = tile.gradients[list.entries[i].slot];
    out.color[0] = sum(sum_red);
    out.color[1] = sum(sum_green);
    out.color[2] = sum(sum_blue);
    out.v = sum(sum_v);
    out.vu = sum(sum_vu);
    out.vw = sum(sum_vw);
    out.vuu = sum(sum_vuu);
    out.vuw = sum(sum_vuw);
    out.vww = sum(sum_vww);
    out.depth = kWithDepth ? sum(sum_depth) : 0.0f;
  }
}

}  // namespace aa4d::AA4D_ARCH

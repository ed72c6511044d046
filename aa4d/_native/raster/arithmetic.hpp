// What the benchmark measures the blending against: how many contributions of a Gaussian to a pixel there are, and the
// time that their bare arithmetic takes on data that stays in registers or the first cache line.
#pragma once

#include "raster/blend_backward.hpp"

namespace aa4d::raster::AA4D_ARCH {

// The contributions that the forward pass added: what passes the cut-off before the pixel was finished.
inline std::uint64_t count_pairs(const BackwardTile& tile) {
  const Float cutoff(tile.log2_min_alpha);
  BackwardBatch batch(tile);
  std::uint64_t pairs = 0;
  for (std::int32_t left = batch.last(); left > 0;) {
    const int taken = batch.fill(left);
    for (int e = 0; e < taken; ++e) {
      const SplatView& view = batch.view(e);
      for (const std::uint32_t* block = batch.begin(e); block != batch.end(e); ++block) {
        for (int k = 0; k < kBlockPixels; k += Float::kWidth) {
          const int p = static_cast<int>(*block) * kBlockPixels + k;
          const Float x = Float::load(kGrid.pixel_x + p), y = Float::load(kGrid.pixel_y + p);
          const Mask passes = view.log2_alpha(view.u(x, y), view.w(y)) >= cutoff;
          pairs += __builtin_popcount(bits(passes & above(tile.pixel_end + p, left - 1 - e)));
        }
      }
    }
    left -= taken;
  }
  return pairs;
}

// The state of a few blocks of pixels, so that their chains of dependent operations overlap. Small enough for the
// registers of AVX-512; other instruction sets spill some of it to the first-level cache.
inline constexpr int kChains = 3;

struct Chain {
  Float u, w, transmittance, red, green, blue;

  explicit Chain(int i) : u(0.1f * (i + 1)), w(0.2f), transmittance(1.0f), red(0.0f), green(0.0f), blue(0.0f) {}
};

// The arithmetic of forward_tile for `pairs` contributions: position, exponential, blending of three channels. Returns
// something that depends on all of it.
inline float forward_arithmetic(std::uint64_t pairs) {
  const Float log2_opacity(-20.0f), du(1e-6f), dw(-1e-6f), max_alpha(static_cast<float>(kMaxAlpha));
  const Float cutoff(-21.0f), min_transmittance(1e-4f), red(0.3f), green(0.4f), blue(0.5f);
  Chain chains[kChains] = {Chain(0), Chain(1), Chain(2)};
  for (std::uint64_t done = 0; done < pairs; done += kChains * Float::kWidth) {
    for (Chain& c : chains) {
      c.u = c.u + du;
      c.w = c.w + dw;
      const Float exponent = fnma(c.w, c.w, fnma(c.u, c.u, log2_opacity));
      const Float alpha = zero_unless(exponent >= cutoff, min(exp2_nonpositive(exponent), max_alpha));
      const Float after = fnma(alpha, c.transmittance, c.transmittance);
      const Float weight = zero_unless(after > min_transmittance, alpha * c.transmittance);
      c.red = fma(weight, red, c.red);
      c.green = fma(weight, green, c.green);
      c.blue = fma(weight, blue, c.blue);
      c.transmittance = after;
    }
  }
  float result = 0;
  for (const Chain& c : chains) result += sum(c.red) + sum(c.green) + sum(c.blue) + sum(c.transmittance);
  return result;
}

// The arithmetic of backward_tile likewise: position, exponential, one reciprocal, the gradient of alpha, and the nine
// sums of a Gaussian.
inline float backward_arithmetic(std::uint64_t pairs) {
  constexpr int kTwo = 2;  // chains: the nine sums take the registers
  const Float log2_opacity(-7.0f), du(1e-6f), dw(-1e-6f), max_alpha(static_cast<float>(kMaxAlpha)), one(1.0f),
      zero(0.0f);
  const Float cutoff(-8.0f), g_red(0.3f), g_green(0.4f), g_blue(0.5f), red(0.6f), green(0.7f), blue(0.8f);
  Float sums[9];
  for (Float& s : sums) s = zero;
  Chain chains[kTwo] = {Chain(0), Chain(1)};
  Float behind[kTwo] = {zero, zero};
  for (std::uint64_t done = 0; done < pairs; done += kTwo * Float::kWidth) {
    for (int i = 0; i < kTwo; ++i) {
      Chain& c = chains[i];
      c.u = c.u + du;
      c.w = c.w + dw;
      const Float exponent = fnma(c.w, c.w, fnma(c.u, c.u, log2_opacity));
      const Float unclamped = exp2_nonpositive(exponent);
      const Float alpha = zero_unless(exponent >= cutoff, min(unclamped, max_alpha));
      const Float inverse = reciprocal(one - alpha);
      c.transmittance = min(c.transmittance * inverse, one);
      const Float weight = alpha * c.transmittance;
      const Float cg = fma(blue, g_blue, fma(green, g_green, red * g_red));
      const Float alpha_gradient = fnma(behind[i], inverse, c.transmittance * cg);
      behind[i] = fma(weight, cg, behind[i]);
      const Float v = zero_unless(unclamped <= max_alpha, alpha * alpha_gradient);
      const Float vu = v * c.u, vw = v * c.w;
      sums[0] = fma(weight, g_red, sums[0]);
      sums[1] = fma(weight, g_green, sums[1]);
      sums[2] = fma(weight, g_blue, sums[2]);
      sums[3] = sums[3] + v;
      sums[4] = sums[4] + vu;
      sums[5] = sums[5] + vw;
      sums[6] = fma(vu, c.u, sums[6]);
      sums[7] = fma(vu, c.w, sums[7]);
      sums[8] = fma(vw, c.w, sums[8]);
    }
  }
  float result = 0;
  for (const Float& s : sums) result += sum(s);
  return result + sum(chains[0].transmittance) + sum(chains[1].transmittance) + sum(behind[0]) + sum(behind[1]);
}

}  // namespace aa4d::raster::AA4D_ARCH

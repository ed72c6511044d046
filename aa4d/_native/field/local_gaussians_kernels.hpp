// The K local Gaussians of an anchor from what the decoders say, and back.
#pragma once

#include "field/kernels.hpp"
#include "field/vector.hpp"

namespace aa4d::field::AA4D_ARCH {

inline Vector magnitude(Vector x) { return x < 0.0f ? -x : x; }

inline Vector sigmoid(Vector x) {
  const Vector e = exp_nonpositive(-magnitude(x));
  return (x < 0.0f ? e : splat(1.0f)) / (1.0f + e);
}

// The series where 1 - e^(-2|x|) would lose bits.
inline Vector tanh(Vector x) {
  const Vector a = magnitude(x), e = exp_nonpositive(-2.0f * a), x2 = x * x;
  const Vector far = (1.0f - e) / (1.0f + e);
  const Vector near = x * (1.0f + x2 * (-1.0f / 3 + x2 * (2.0f / 15 + x2 * (-17.0f / 315 + x2 * (62.0f / 2835)))));
  return a < 0.25f ? near : (x < 0.0f ? -far : far);
}

// f(value, ...) for every place of arrays of `count` floats.
template <class Function>
inline void for_each(int count, const Function& f) {
  int i = 0;
  for (; i + kWidth <= count; i += kWidth) f.template operator()<true>(i, kWidth);
  if (i < count) f.template operator()<false>(i, count - i);
}

// The three shares of scale of each Gaussian, from rows of 7.
inline void sigmoid_of_shares(const float* covariance, int offsets, float* shares) {
  for (int k = 0; k < offsets; ++k) {
    for (int j = 0; j < 3; ++j) shares[3 * k + j] = covariance[7 * k + j];
  }
  for_each(3 * offsets, [&]<bool kWhole>(int i, int lanes) {
    store<kWhole>(shares + i, sigmoid(load<kWhole>(shares + i, lanes)), lanes);
  });
}

inline void make_gaussians(const AnchorOutputs& a, std::size_t begin, std::size_t end, const LocalGaussians& out) {
  const int K = a.offsets;
  float shares[3 * kMaxOffsets];
  for (std::size_t n = begin; n < end; ++n) {
    const float *const position = a.position + 3 * n, *const scale = a.scale + 6 * n;
    const float *const offset = a.offset + 3 * n * K, *const covariance = a.covariance + 7 * n * K;
    sigmoid_of_shares(covariance, K, shares);
    float *const means = out.means + 3 * n * K, *const scales = out.scales + 3 * n * K;
    float* const quaternions = out.quaternions + 4 * n * K;
    for (int k = 0; k < K; ++k) {
      for (int j = 0; j < 3; ++j) {
        means[3 * k + j] = position[j] + offset[3 * k + j] * scale[j];
        scales[3 * k + j] = scale[3 + j] * shares[3 * k + j];
      }
      for (int j = 0; j < 4; ++j) quaternions[4 * k + j] = covariance[7 * k + 3 + j];
    }
  }
  const std::size_t first = begin * K;
  const int count = static_cast<int>(end - begin) * K;
  for_each(count, [&]<bool kWhole>(int i, int lanes) {
    const Vector t = tanh(load<kWhole>(a.opacity + first + i, lanes));
    store<kWhole>(out.opacities + first + i, t < 0.0f ? Vector{} : t, lanes);
  });
  for_each(3 * count, [&]<bool kWhole>(int i, int lanes) {
    store<kWhole>(out.colors + 3 * first + i, sigmoid(load<kWhole>(a.color + 3 * first + i, lanes)), lanes);
  });
}

inline void make_gaussians_backward(const AnchorOutputs& a, std::size_t begin, std::size_t end,
                                    const LocalGaussians& value, const LocalGaussians& d, const AnchorGradient& out) {
  const int K = a.offsets;
  float shares[3 * kMaxOffsets];
  for (std::size_t n = begin; n < end; ++n) {
    const float *const scale = a.scale + 6 * n, *const offset = a.offset + 3 * n * K;
    sigmoid_of_shares(a.covariance + 7 * n * K, K, shares);
    const float *const d_means = d.means + 3 * n * K, *const d_scales = d.scales + 3 * n * K;
    const float* const d_quaternions = d.quaternions + 4 * n * K;
    float *const d_covariance = out.covariance + 7 * n * K, *const d_offset = out.offset + 3 * n * K;
    float d_position[3] = {}, d_scale[6] = {};
    for (int k = 0; k < K; ++k) {
      for (int j = 0; j < 3; ++j) {
        const int i = 3 * k + j;
        d_position[j] += d_means[i];
        d_scale[j] += d_means[i] * offset[i];
        d_scale[3 + j] += d_scales[i] * shares[i];
        d_offset[i] = d_means[i] * scale[j];
        d_covariance[7 * k + j] = d_scales[i] * scale[3 + j] * shares[i] * (1 - shares[i]);
      }
      for (int j = 0; j < 4; ++j) d_covariance[7 * k + 3 + j] = d_quaternions[4 * k + j];
    }
    for (int j = 0; j < 3; ++j) out.position[3 * n + j] = d_position[j];
    for (int j = 0; j < 6; ++j) out.scale[6 * n + j] = d_scale[j];
  }
  const std::size_t first = begin * K;
  const int count = static_cast<int>(end - begin) * K;
  for_each(count, [&]<bool kWhole>(int i, int lanes) {
    const Vector t = load<kWhole>(value.opacities + first + i, lanes), g = load<kWhole>(d.opacities + first + i, lanes);
    const Vector raw = load<kWhole>(a.opacity + first + i, lanes);
    store<kWhole>(out.opacity + first + i, raw < 0.0f ? Vector{} : g * (1.0f - t * t), lanes);
  });
  for_each(3 * count, [&]<bool kWhole>(int i, int lanes) {
    const Vector c = load<kWhole>(value.colors + 3 * first + i, lanes);
    const Vector g = load<kWhole>(d.colors + 3 * first + i, lanes);
    store<kWhole>(out.color + 3 * first + i, g * c * (1.0f - c), lanes);
  });
}

}  // namespace aa4d::field::AA4D_ARCH

// Interpolation in the six planes, and their weighted sum or product, a register of channels at a time.
#pragma once

#include "field/kernels.hpp"
#include "field/vector.hpp"

namespace aa4d::field::AA4D_ARCH {

// Which coordinates run along a plane's columns and rows; a plane of time has one row and needs the first alone.
inline constexpr int kColumnAxis[kPlanes] = {0, 0, 1, 0, 1, 2};
inline constexpr int kRowAxis[3] = {1, 2, 2};

// A place between two texels of an axis of `size` texels; -1 and 1 are the centres of the first and the last.
struct Place {
  int lower, upper;
  float fraction;

  Place(float u, int size) {
    const float last = static_cast<float>(size - 1);
    float x = (u + 1) * 0.5f * last;
    x = x > 0 ? (x < last ? x : last) : 0;  // NaN becomes 0: no texel outside is ever touched
    lower = static_cast<int>(x);
    if (lower > 0 && lower == size - 1) --lower;
    upper = lower + (size > 1);
    fraction = x - static_cast<float>(lower);
  }
};

// The texels that a query touches on one plane, and how much of each.
struct Texels {
  const float* corner[4];
  float share[4];
  int count;

  Texels(const Plane& plane, int index, int channels, const float* query) {
    const Place column(query[kColumnAxis[index]], plane.columns);
    const float* const texels = plane.texels;
    const auto at = [&](int row, int x) {
      return texels + (static_cast<std::size_t>(row) * plane.columns + x) * channels;
    };
    if (index >= 3) {
      corner[0] = at(0, column.lower), share[0] = 1 - column.fraction;
      corner[1] = at(0, column.upper), share[1] = column.fraction;
      count = 2;
      return;
    }
    const Place row(query[kRowAxis[index]], plane.rows);
    corner[0] = at(row.lower, column.lower), share[0] = (1 - row.fraction) * (1 - column.fraction);
    corner[1] = at(row.lower, column.upper), share[1] = (1 - row.fraction) * column.fraction;
    corner[2] = at(row.upper, column.lower), share[2] = row.fraction * (1 - column.fraction);
    corner[3] = at(row.upper, column.upper), share[3] = row.fraction * column.fraction;
    count = 4;
  }

  template <bool kWhole>
  Vector interpolate(int channel, int lanes) const {
    Vector v =
        load<kWhole>(corner[0] + channel, lanes) * share[0] + load<kWhole>(corner[1] + channel, lanes) * share[1];
    if (count == 4) {
      v += load<kWhole>(corner[2] + channel, lanes) * share[2] + load<kWhole>(corner[3] + channel, lanes) * share[3];
    }
    return v;
  }
};

template <bool kWhole>
inline void softmax(const float* scores, int channels, int lanes, Vector (&w)[kPlanes]) {
  for (int p = 0; p < kPlanes; ++p) w[p] = load<kWhole>(scores + p * channels, lanes);
  Vector most = w[0];
  for (int p = 1; p < kPlanes; ++p) most = larger(most, w[p]);
  Vector total = {};
  for (int p = 0; p < kPlanes; ++p) {
    w[p] = exp_nonpositive(w[p] - most);
    total += w[p];
  }
  const Vector inverse = 1.0f / total;
  for (int p = 0; p < kPlanes; ++p) w[p] *= inverse;
}

template <bool kWhole>
inline void look_up_channels(const Lookup& lookup, std::size_t anchor, int channel, int lanes, float* features,
                             float* weights) {
  const int channels = lookup.channels;
  const float* const query = lookup.query + 3 * anchor;
  Vector w[kPlanes];
  if (!lookup.is_product) {
    const std::size_t first = anchor * kPlanes * channels + channel;
    softmax<kWhole>(lookup.scores + first, channels, lanes, w);
    for (int p = 0; p < kPlanes; ++p) store<kWhole>(weights + first + p * channels, w[p], lanes);
  }
  for (int level = 0; level < lookup.levels; ++level) {
    Vector result = splat(lookup.is_product ? 1.0f : 0.0f);
    for (int p = 0; p < kPlanes; ++p) {
      const Vector g = Texels(lookup.planes[level][p], p, channels, query).interpolate<kWhole>(channel, lanes);
      if (lookup.is_product)
        result *= g;
      else
        result += w[p] * g;
    }
    store<kWhole>(features + (anchor * lookup.levels + level) * channels + channel, result, lanes);
  }
}

template <bool kWhole>
inline void backward_channels(const Lookup& lookup, std::size_t anchor, int channel, int lanes, const float* weights,
                              const float* d_features, float* result) {
  const int channels = lookup.channels;
  const float* const query = lookup.query + 3 * anchor;
  Vector d_weight[kPlanes] = {};
  for (int level = 0; level < lookup.levels; ++level) {
    const std::size_t row = anchor * lookup.levels + level;
    Vector g[kPlanes];
    for (int p = 0; p < kPlanes; ++p) {
      g[p] = Texels(lookup.planes[level][p], p, channels, query).interpolate<kWhole>(channel, lanes);
    }
    if (!lookup.is_product) {
      const Vector d = load<kWhole>(d_features + row * channels + channel, lanes);
      for (int p = 0; p < kPlanes; ++p) d_weight[p] += d * g[p];
      continue;
    }
    // The product of the planes before p times that of those after: no division, so zeros are harmless.
    Vector before[kPlanes], after = splat(1.0f);
    before[0] = after;
    for (int p = 1; p < kPlanes; ++p) before[p] = before[p - 1] * g[p - 1];
    for (int p = kPlanes - 1; p >= 0; --p) {
      store<kWhole>(result + (row * kPlanes + p) * channels + channel, before[p] * after, lanes);
      after *= g[p];
    }
  }
  if (lookup.is_product) return;
  const std::size_t first = anchor * kPlanes * channels + channel;
  Vector w[kPlanes], mean = {};
  for (int p = 0; p < kPlanes; ++p) {
    w[p] = load<kWhole>(weights + first + p * channels, lanes);
    mean += w[p] * d_weight[p];
  }
  for (int p = 0; p < kPlanes; ++p) store<kWhole>(result + first + p * channels, w[p] * (d_weight[p] - mean), lanes);
}

inline void look_up(const Lookup& lookup, std::size_t begin, std::size_t end, float* features, float* weights) {
  const int whole = lookup.channels / kWidth * kWidth;
  for (std::size_t i = begin; i < end; ++i) {
    for (int c = 0; c < whole; c += kWidth) look_up_channels<true>(lookup, i, c, kWidth, features, weights);
    if (whole < lookup.channels) look_up_channels<false>(lookup, i, whole, lookup.channels - whole, features, weights);
  }
}

inline void look_up_backward(const Lookup& lookup, std::size_t begin, std::size_t end, const float* weights,
                             const float* d_features, float* result) {
  const int whole = lookup.channels / kWidth * kWidth;
  for (std::size_t i = begin; i < end; ++i) {
    for (int c = 0; c < whole; c += kWidth) backward_channels<true>(lookup, i, c, kWidth, weights, d_features, result);
    if (whole < lookup.channels) {
      backward_channels<false>(lookup, i, whole, lookup.channels - whole, weights, d_features, result);
    }
  }
}

inline void scatter(const Lookup& lookup, std::size_t count, int level, int plane, const float* factors,
                    const float* d_features, float* d_texels) {
  const int channels = lookup.channels, whole = channels / kWidth * kWidth;
  const Plane target = {d_texels, lookup.planes[level][plane].rows, lookup.planes[level][plane].columns};
  for (std::size_t i = 0; i < count; ++i) {
    const Texels texels(target, plane, channels, lookup.query + 3 * i);
    const std::size_t row = i * lookup.levels + level;
    const float* const d = d_features + row * channels;
    const float* const factor = factors + ((lookup.is_product ? row : i) * kPlanes + plane) * channels;
    for (int c = 0; c < whole; c += kWidth) {
      const Vector g = load(d + c) * load(factor + c);
      for (int k = 0; k < texels.count; ++k) {
        float* const texel = const_cast<float*>(texels.corner[k]) + c;
        store(texel, load(texel) + g * texels.share[k]);
      }
    }
    for (int c = whole; c < channels; ++c) {
      for (int k = 0; k < texels.count; ++k)
        const_cast<float*>(texels.corner[k])[c] += d[c] * factor[c] * texels.share[k];
    }
  }
}

}  // namespace aa4d::field::AA4D_ARCH

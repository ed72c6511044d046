// SSIM, absolute and squared error, row by row. Pixels are interleaved (r g b r g b ...), so a horizontal neighbour is
// three floats away and every filter runs over whole registers of one row.
#pragma once

#include "field/kernels.hpp"
#include "field/vector.hpp"

namespace aa4d::field::AA4D_ARCH {

// exp(-(i / 1.5)^2 / 2), i = -5..5, divided by their sum.
inline constexpr float kWindow[kTaps] = {0.00102838008f, 0.00759875814f, 0.0360007721f, 0.10936069f,
                                         0.213005538f,   0.266011725f,   0.213005538f,  0.10936069f,
                                         0.0360007721f,  0.00759875814f, 0.00102838008f};
inline constexpr float kLuminance = 0.01f * 0.01f, kContrast = 0.03f * 0.03f;

// Rows of scratch memory have kMargin zeros on both sides of the image's row.
inline float* margin_row(float* padding, int width, int index) {
  return padding + static_cast<std::ptrdiff_t>(index) * (width + 2 * kMargin) + kMargin;
}

inline void clear_margins(float* row, int width) {
  for (int i = 1; i <= kMargin; ++i) row[-i] = 0;
  for (int i = 0; i < kMargin; ++i) row[width + i] = 0;
}

// A register's worth may reach past the row's end, where `out` has other content.
inline void filter_along(const float* row, int width, float* out) {
  const auto at = [&](int x) {
    Vector total = {};
    for (int k = 0; k < kTaps; ++k) total += load(row + x + 3 * (k - kHalf)) * kWindow[k];
    return total;
  };
  int x = 0;
  for (; x + kWidth <= width; x += kWidth) store(out + x, at(x));
  if (x < width) store<false>(out + x, at(x), width - x);
}

// One register of column sums around a row.
template <bool kWhole>
inline Vector filter_down(const SimilarityRows& s, const float* map, int row, int x, int lanes) {
  Vector total = {};
  const int first = row < kHalf ? 0 : row - kHalf, last = row + kHalf < s.height ? row + kHalf : s.height - 1;
  for (int y = first; y <= last; ++y) {
    total += load<kWhole>(map + static_cast<std::size_t>(y) * s.width + x, lanes) * kWindow[y - row + kHalf];
  }
  return total;
}

inline void filter_row(const SimilarityRows& s, int row, float* padding) {
  const std::size_t first = static_cast<std::size_t>(row) * s.width, map = static_cast<std::size_t>(s.width) * s.height;
  const float *const x = s.image + first, *const y = s.target + first;
  float* rows[5];
  for (int i = 0; i < 5; ++i) {
    rows[i] = margin_row(padding, s.width, i);
    clear_margins(rows[i], s.width);
  }
  for (int i = 0; i < s.width; ++i) {
    rows[0][i] = x[i];
    rows[1][i] = y[i];
    rows[2][i] = x[i] * x[i];
    rows[3][i] = y[i] * y[i];
    rows[4][i] = x[i] * y[i];
  }
  for (int i = 0; i < 5; ++i) filter_along(rows[i], s.width, s.filtered + i * map + first);
}

template <bool kWhole>
inline void compare_lanes(const SimilarityRows& s, int row, int x, int lanes, float* const (&out)[3],
                          Vector (&totals)[3]) {
  const std::size_t map = static_cast<std::size_t>(s.width) * s.height;
  Vector f[5];
  for (int i = 0; i < 5; ++i) f[i] = filter_down<kWhole>(s, s.filtered + i * map, row, x, lanes);
  const Vector mean_x = f[0], mean_y = f[1], both = f[0] * f[1], squares = f[0] * f[0] + f[1] * f[1];
  const Vector a = 2.0f * both + kLuminance, b = squares + kLuminance;
  const Vector c = 2.0f * (f[4] - both) + kContrast, d = (f[2] + f[3]) - squares + kContrast;
  const Vector inverse = 1.0f / (b * d), value = a * c * inverse;
  const std::size_t place = static_cast<std::size_t>(row) * s.width + x;
  const Vector error = load<kWhole>(s.image + place, lanes) - load<kWhole>(s.target + place, lanes);
  const Vector terms[3] = {value, error < 0.0f ? -error : error, error * error};
  for (int k = 0; k < 3; ++k) {
    if constexpr (kWhole) {
      totals[k] += terms[k];
    } else {
      for (int i = 0; i < lanes; ++i) totals[k][i] += terms[k][i];
    }
  }
  if (s.derivatives == nullptr) return;
  // value = a c / (b d); of the filtered maps, a depends on mean_x, b on it too, c on mean_x and mean_xy, d on mean_x
  // and mean_xx.
  const Vector by_d = -value / d, by_c = a * inverse;
  const Vector by_mean = 2.0f * mean_y * (c * inverse - by_c) + 2.0f * mean_x * (-value / b - by_d);
  store<kWhole>(out[0] + x, by_mean, lanes);
  store<kWhole>(out[1] + x, by_d, lanes);
  store<kWhole>(out[2] + x, 2.0f * by_c, lanes);
}

inline RowErrors compare_row(const SimilarityRows& s, int row, float* padding) {
  float* out[3];
  for (int i = 0; i < 3; ++i) {
    out[i] = margin_row(padding, s.width, i);
    clear_margins(out[i], s.width);
  }
  Vector totals[3] = {};
  int x = 0;
  for (; x + kWidth <= s.width; x += kWidth) compare_lanes<true>(s, row, x, kWidth, out, totals);
  if (x < s.width) compare_lanes<false>(s, row, x, s.width - x, out, totals);
  if (s.derivatives != nullptr) {
    const std::size_t first = static_cast<std::size_t>(row) * s.width,
                      map = static_cast<std::size_t>(s.width) * s.height;
    for (int i = 0; i < 3; ++i) filter_along(out[i], s.width, s.derivatives + i * map + first);
  }
  return {sum(totals[0]), sum(totals[1]), sum(totals[2])};
}

template <bool kWhole>
inline void differentiate_lanes(const SimilarityRows& s, int row, int x, int lanes) {
  const std::size_t place = static_cast<std::size_t>(row) * s.width + x,
                    map = static_cast<std::size_t>(s.width) * s.height;
  Vector d[3];
  for (int i = 0; i < 3; ++i) d[i] = filter_down<kWhole>(s, s.derivatives + i * map, row, x, lanes);
  const Vector image = load<kWhole>(s.image + place, lanes), target = load<kWhole>(s.target + place, lanes);
  const Vector up = splat(s.by_absolute);
  const Vector absolute = image > target ? up : (image < target ? -up : Vector{});
  store<kWhole>(s.gradient + place, s.by_similarity * (d[0] + 2.0f * image * d[1] + target * d[2]) + absolute, lanes);
}

inline void differentiate_row(const SimilarityRows& s, int row) {
  int x = 0;
  for (; x + kWidth <= s.width; x += kWidth) differentiate_lanes<true>(s, row, x, kWidth);
  if (x < s.width) differentiate_lanes<false>(s, row, x, s.width - x);
}

}  // namespace aa4d::field::AA4D_ARCH

// The regularisers of a plane and their gradient in one sweep.
#pragma once

#include "field/kernels.hpp"
#include "field/vector.hpp"

namespace aa4d::field::AA4D_ARCH {

template <bool kWhole>
inline void penalise_lanes(const Penalty& penalty, int row, int column, int lanes, Vector& squares, Vector& distances) {
  const auto at = [&](int r) {
    return load<kWhole>(penalty.plane + static_cast<std::size_t>(r) * penalty.width + column, lanes);
  };
  // The second difference that is centred on a row; none on the first and the last.
  const auto difference = [&](int r) {
    return r < 1 || r > penalty.rows - 2 ? Vector{} : at(r + 1) - 2.0f * at(r) + at(r - 1);
  };
  const Vector value = at(row), here = difference(row);
  squares += here * here;
  const Vector from_one = 1.0f - value;
  if (penalty.constancy != 0) {
    const Vector distance = from_one < 0.0f ? -from_one : from_one;
    if constexpr (kWhole) {
      distances += distance;
    } else {
      for (int i = 0; i < lanes; ++i) distances[i] += distance[i];
    }
  }
  if (penalty.gradient == nullptr) return;
  Vector gradient = 2.0f * penalty.smoothness * (difference(row - 1) - 2.0f * here + difference(row + 1));
  if (penalty.constancy != 0) {
    const Vector up = splat(penalty.constancy);
    gradient += from_one < 0.0f ? up : (from_one > 0.0f ? -up : Vector{});
  }
  store<kWhole>(penalty.gradient + static_cast<std::size_t>(row) * penalty.width + column, gradient, lanes);
}

inline double penalise(const Penalty& penalty, int begin, int end) {
  const int whole = penalty.width / kWidth * kWidth;
  double value = 0;
  for (int row = begin; row < end; ++row) {
    Vector squares = {}, distances = {};
    for (int x = 0; x < whole; x += kWidth) penalise_lanes<true>(penalty, row, x, kWidth, squares, distances);
    if (whole < penalty.width) penalise_lanes<false>(penalty, row, whole, penalty.width - whole, squares, distances);
    value += penalty.smoothness * sum(squares) + penalty.constancy * sum(distances);
  }
  return value;
}

}  // namespace aa4d::field::AA4D_ARCH

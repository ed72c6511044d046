// The six planes at every level, looked up by all anchors at one time. Results do not depend on the number of threads:
// every anchor is one thread's, and so is every plane whose gradient is summed.
#pragma once

#include <cstddef>

#include "common/buffer.hpp"
#include "field/kernels.hpp"

namespace aa4d::field {

// What a caller gives; planes are [rows, columns, C], the rows of the last three of a level run along time.
struct Query {
  Plane planes[kMaxLevels][kPlanes];
  int levels, channels;
  std::size_t anchors;
  const float* coordinates;  // [N, 3] in [-1, 1]
  float time;                // in [0, 1]
  const float* scores;       // [N, 6, C]; null for the product
};

// Writes features [N, L C] and, unless it is null, weights [N, 6, C].
void look_up_planes(const Query& query, int threads, float* features, float* weights);

// Writes `result`: the gradient of the scores [N, 6, C], or scratch memory [N, L, 6, C] for the product; and the
// gradients of the planes, [L][6] in their layout.
void look_up_planes_backward(const Query& query, int threads, const float* weights, const float* d_features,
                             float* result, float* const (*d_planes)[kPlanes]);

}  // namespace aa4d::field

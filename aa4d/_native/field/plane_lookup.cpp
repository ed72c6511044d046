#include "field/plane_lookup.hpp"

#include <algorithm>

#include "common/thread_pool.hpp"

namespace aa4d::field {
namespace {

constexpr std::size_t kChunk = 256;  // anchors

// The two rows of a plane of time between which a time lies.
struct Rows {
  int lower, upper;
  float fraction;

  Rows(float time, int rows) {
    const float last = static_cast<float>(rows - 1);
    const float x = std::min(std::max(0.0f, time * last), last);  // NaN becomes 0
    lower = std::min(static_cast<int>(x), std::max(rows - 2, 0));
    upper = std::min(lower + 1, rows - 1);
    fraction = x - static_cast<float>(lower);
  }
};

// All anchors share one time, so each plane of time is one row: the two around that time, interpolated once.
Lookup at_time(const Query& query, Buffer<float>& storage) {
  Lookup lookup = {};
  std::size_t needed = 0;
  for (int level = 0; level < query.levels; ++level) {
    for (int p = 3; p < kPlanes; ++p)
      needed += static_cast<std::size_t>(query.planes[level][p].columns) * query.channels;
  }
  storage.resize_discarding(needed);
  float* row = storage.data();
  for (int level = 0; level < query.levels; ++level) {
    for (int p = 0; p < kPlanes; ++p) {
      const Plane& plane = query.planes[level][p];
      lookup.planes[level][p] = plane;
      if (p < 3) continue;
      const std::size_t width = static_cast<std::size_t>(plane.columns) * query.channels;
      const Rows rows(query.time, plane.rows);
      const float *const lower = plane.texels + rows.lower * width, *const upper = plane.texels + rows.upper * width;
      for (std::size_t i = 0; i < width; ++i) row[i] = (1 - rows.fraction) * lower[i] + rows.fraction * upper[i];
      lookup.planes[level][p] = {row, 1, plane.columns};
      row += width;
    }
  }
  lookup.levels = query.levels;
  lookup.channels = query.channels;
  lookup.is_product = query.scores == nullptr;
  lookup.query = query.coordinates;
  lookup.scores = query.scores;
  return lookup;
}

template <class Body>
void for_chunks(std::size_t count, int threads, const Body& body) {
  parallel_for(threads, (count + kChunk - 1) / kChunk,
               [&](std::size_t chunk) { body(chunk * kChunk, std::min(count, (chunk + 1) * kChunk)); });
}

}  // namespace

void look_up_planes(const Query& query, int threads, float* features, float* weights) {
  Buffer<float> rows;
  const Lookup lookup = at_time(query, rows);
  for_chunks(query.anchors, threads,
             [&](std::size_t begin, std::size_t end) { kernels().look_up(lookup, begin, end, features, weights); });
}

void look_up_planes_backward(const Query& query, int threads, const float* weights, const float* d_features,
                             float* result, float* const (*d_planes)[kPlanes]) {
  Buffer<float> rows, d_rows;
  const Lookup lookup = at_time(query, rows);
  for_chunks(query.anchors, threads, [&](std::size_t begin, std::size_t end) {
    kernels().look_up_backward(lookup, begin, end, weights, d_features, result);
  });
  const float* const factors = lookup.is_product ? result : weights;
  d_rows.resize_discarding(rows.size());
  // The largest planes first: the last task to finish is then a short one.
  parallel_for(threads, static_cast<std::size_t>(query.levels) * kPlanes, [&](std::size_t task) {
    const int level = query.levels - 1 - static_cast<int>(task / kPlanes), p = static_cast<int>(task % kPlanes);
    const Plane& plane = query.planes[level][p];
    const std::size_t width = static_cast<std::size_t>(plane.columns) * query.channels;
    float* const d_plane = d_planes[level][p];
    std::fill_n(d_plane, width * plane.rows, 0.0f);
    if (p < 3) return kernels().scatter(lookup, query.anchors, level, p, factors, d_features, d_plane);
    float* const d_row = d_rows.data() + (lookup.planes[level][p].texels - rows.data());
    std::fill_n(d_row, width, 0.0f);
    kernels().scatter(lookup, query.anchors, level, p, factors, d_features, d_row);
    const Rows at(query.time, plane.rows);
    for (std::size_t i = 0; i < width; ++i) {
      d_plane[at.lower * width + i] += (1 - at.fraction) * d_row[i];
      d_plane[at.upper * width + i] += at.fraction * d_row[i];
    }
  });
}

}  // namespace aa4d::field

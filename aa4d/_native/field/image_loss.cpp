#include "field/image_loss.hpp"

#include <algorithm>
#include <vector>

#include "common/buffer.hpp"
#include "common/thread_pool.hpp"
#include "field/kernels.hpp"

namespace aa4d::field {
namespace {

float* padding_for(int width) {
  static thread_local Buffer<float> memory;
  memory.resize_discarding(static_cast<std::size_t>(kSimilarityRows) * (width + 2 * kMargin));
  return memory.data();
}

template <class Body>
void for_rows(int height, int threads, const Body& body) {
  constexpr int kRows = 8;
  parallel_for(threads, (height + kRows - 1) / kRows, [&](std::size_t task) {
    const int begin = static_cast<int>(task) * kRows;
    for (int row = begin; row < std::min(begin + kRows, height); ++row) body(row);
  });
}

}  // namespace

ImageErrors compare_images(int height, int width, const float* image, const float* target, float dssim, float* gradient,
                           int threads) {
  const std::size_t map = static_cast<std::size_t>(height) * width * 3;
  Buffer<float> filtered, derivatives;
  filtered.resize_discarding(5 * map);
  if (gradient) derivatives.resize_discarding(3 * map);
  const SimilarityRows rows = {3 * width,
                               height,
                               image,
                               target,
                               filtered.data(),
                               gradient ? derivatives.data() : nullptr,
                               gradient,
                               -dssim / static_cast<float>(map),
                               (1 - dssim) / static_cast<float>(map)};
  std::vector<RowErrors> sums(height);
  for_rows(height, threads, [&](int row) { kernels().filter_row(rows, row, padding_for(rows.width)); });
  for_rows(height, threads, [&](int row) { sums[row] = kernels().compare_row(rows, row, padding_for(rows.width)); });
  if (gradient) for_rows(height, threads, [&](int row) { kernels().differentiate_row(rows, row); });
  ImageErrors mean = {};
  for (const RowErrors& sum : sums) {
    mean.similarity += sum.similarity / static_cast<double>(map);
    mean.absolute += sum.absolute / static_cast<double>(map);
    mean.squared += sum.squared / static_cast<double>(map);
  }
  return mean;
}

}  // namespace aa4d::field

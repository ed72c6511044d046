#include "field/plane_penalty.hpp"

#include <algorithm>
#include <vector>

#include "common/thread_pool.hpp"

namespace aa4d::field {

double penalise_planes(const Penalty* penalties, std::size_t count, int threads) {
  constexpr int kRows = 16;
  struct Part {
    std::size_t plane;
    int begin, end;
  };
  std::vector<Part> parts;
  for (std::size_t i = 0; i < count; ++i) {
    for (int row = 0; row < penalties[i].rows; row += kRows) {
      parts.push_back({i, row, std::min(row + kRows, penalties[i].rows)});
    }
  }
  std::vector<double> values(parts.size());
  parallel_for(threads, parts.size(), [&](std::size_t part) {
    values[part] = kernels().penalise(penalties[parts[part].plane], parts[part].begin, parts[part].end);
  });
  double total = 0;
  for (const double value : values) total += value;
  return total;
}

}  // namespace aa4d::field

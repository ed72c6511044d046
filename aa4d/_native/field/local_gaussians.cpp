#include "field/local_gaussians.hpp"

#include <algorithm>

#include "common/thread_pool.hpp"

namespace aa4d::field {
namespace {

constexpr std::size_t kChunk = 256;  // anchors

}  // namespace

void make_local_gaussians(const AnchorOutputs& anchors, std::size_t count, int threads, const LocalGaussians& out) {
  parallel_for(threads, (count + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    kernels().make_gaussians(anchors, chunk * kChunk, std::min(count, (chunk + 1) * kChunk), out);
  });
}

void make_local_gaussians_backward(const AnchorOutputs& anchors, std::size_t count, int threads,
                                   const LocalGaussians& value, const LocalGaussians& d, const AnchorGradient& out) {
  parallel_for(threads, (count + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    kernels().make_gaussians_backward(anchors, chunk * kChunk, std::min(count, (chunk + 1) * kChunk), value, d, out);
  });
}

}  // namespace aa4d::field

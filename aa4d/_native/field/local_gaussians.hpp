#pragma once

#include <cstddef>

#include "field/kernels.hpp"

namespace aa4d::field {

void make_local_gaussians(const AnchorOutputs& anchors, std::size_t count, int threads, const LocalGaussians& out);

// `value` needs the opacities and colours alone.
void make_local_gaussians_backward(const AnchorOutputs& anchors, std::size_t count, int threads,
                                   const LocalGaussians& value, const LocalGaussians& d, const AnchorGradient& out);

}  // namespace aa4d::field

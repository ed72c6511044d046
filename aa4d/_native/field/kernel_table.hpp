// The kernels of the instruction set that the including file is compiled for.
#pragma once

#include "field/image_loss_kernels.hpp"
#include "field/local_gaussians_kernels.hpp"
#include "field/plane_lookup_kernels.hpp"
#include "field/plane_penalty_kernels.hpp"
#include "field/two_layer_kernels.hpp"

#define AA4D_TEXT_OF(name) #name
#define AA4D_TEXT(name) AA4D_TEXT_OF(name)

namespace aa4d::field::AA4D_ARCH {

inline constexpr Kernels kKernels = {
    AA4D_TEXT(AA4D_ARCH), &look_up,    &look_up_backward, &scatter,           &penalise,       &network_forward,
    &network_backward,    &filter_row, &compare_row,      &differentiate_row, &make_gaussians, &make_gaussians_backward,
};

}  // namespace aa4d::field::AA4D_ARCH

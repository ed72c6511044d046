#include "field/kernel_table.hpp"
#include "field/rounded_two_layer_kernels.hpp"

namespace aa4d::field {

const Kernels kAvx2Kernels = avx2::kKernels;
const RoundedKernels kRoundedAvx2Kernels = avx2::rounded::kKernels;

}  // namespace aa4d::field

#include "field/kernel_table.hpp"
#include "field/rounded_two_layer_kernels.hpp"

namespace aa4d::field {

const Kernels kAvx512Kernels = avx512::kKernels;
const RoundedKernels kRoundedAvx512Kernels = avx512::rounded::kKernels;

}  // namespace aa4d::field

#include "field/rounded_two_layer_kernels.hpp"

namespace aa4d::field {

const RoundedKernels kRoundedAvx512Bf16Kernels = avx512bf16::rounded::kKernels;

}  // namespace aa4d::field

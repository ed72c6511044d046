#include "field/kernel_table.hpp"
#include "field/rounded_two_layer_kernels.hpp"

namespace aa4d::field {

const Kernels kPortableKernels = portable::kKernels;
const RoundedKernels kRoundedPortableKernels = portable::rounded::kKernels;

}  // namespace aa4d::field

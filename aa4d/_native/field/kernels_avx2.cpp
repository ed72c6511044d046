#include "field/kernel_table.hpp"

namespace aa4d::field {

const Kernels kAvx2Kernels = avx2::kKernels;

}  // namespace aa4d::field

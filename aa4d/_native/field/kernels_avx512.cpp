#include "field/kernel_table.hpp"

namespace aa4d::field {

const Kernels kAvx512Kernels = avx512::kKernels;

}  // namespace aa4d::field

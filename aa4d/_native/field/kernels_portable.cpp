#include "field/kernel_table.hpp"

namespace aa4d::field {

const Kernels kPortableKernels = portable::kKernels;

}  // namespace aa4d::field

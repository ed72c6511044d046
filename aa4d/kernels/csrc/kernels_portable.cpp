#include "kernel_table.hpp"

namespace aa4d {

const Kernels kPortableKernels = portable::kKernels;

}  // namespace aa4d

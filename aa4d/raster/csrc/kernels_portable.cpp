#include "kernel_table.hpp"

namespace aa4d {

const Kernels kPortableKernels = {"portable", &portable::forward, &portable::backward};

}  // namespace aa4d

#include "kernel_table.hpp"

namespace aa4d {

const Kernels kAvx2Kernels = {"avx2", &avx2::forward, &avx2::backward};

}  // namespace aa4d

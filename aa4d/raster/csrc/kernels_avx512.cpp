#include "kernel_table.hpp"

namespace aa4d {

const Kernels kAvx512Kernels = {"avx512", &avx512::forward, &avx512::backward};

}  // namespace aa4d

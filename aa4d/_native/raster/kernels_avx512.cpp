#include "raster/kernel_table.hpp"

namespace aa4d::raster {

const Kernels kAvx512Kernels = avx512::kKernels;

}  // namespace aa4d::raster

#include "raster/kernel_table.hpp"

namespace aa4d::raster {

const Kernels kAvx2Kernels = avx2::kKernels;

}  // namespace aa4d::raster

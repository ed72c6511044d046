#include "raster/kernel_table.hpp"

namespace aa4d::raster {

const Kernels kPortableKernels = portable::kKernels;

}  // namespace aa4d::raster

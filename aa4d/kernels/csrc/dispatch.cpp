#include <cstdlib>
#include <stdexcept>
#include <string>

#include "kernels.hpp"

namespace aa4d {

const Kernels& kernels() {
  static const Kernels& chosen = []() -> const Kernels& {
    const char* const wanted = std::getenv("AA4D_SIMD");
    const std::string name = wanted ? wanted : "";
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (avx512 && (name.empty() || name == "avx512")) return kAvx512Kernels;
    if (avx2 && (name.empty() || name == "avx2")) return kAvx2Kernels;
#endif
    if (name.empty() || name == "portable") return kPortableKernels;
    throw std::invalid_argument("AA4D_SIMD=" + name + ": this machine has no such kernels; use avx512, avx2 or portable");
  }();
  return chosen;
}

}  // namespace aa4d

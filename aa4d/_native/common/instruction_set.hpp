#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace aa4d {

enum class InstructionSet { kPortable, kAvx2, kAvx512 };

// The best one that this machine has, or the one that AA4D_SIMD names. Throws std::invalid_argument where the machine
// has none of that name.
inline InstructionSet choose_instruction_set() {
  const char* const wanted = std::getenv("AA4D_SIMD");
  const std::string name = wanted ? wanted : "";
#if defined(__x86_64__)
  __builtin_cpu_init();
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (avx512 && (name.empty() || name == "avx512")) return InstructionSet::kAvx512;
  if (avx2 && (name.empty() || name == "avx2")) return InstructionSet::kAvx2;
#endif
  if (name.empty() || name == "portable") return InstructionSet::kPortable;
  throw std::invalid_argument("AA4D_SIMD=" + name + ": this machine has no such kernels; use avx512, avx2 or portable");
}

}  // namespace aa4d

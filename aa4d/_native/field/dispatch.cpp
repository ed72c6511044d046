#include "common/instruction_set.hpp"
#include "field/kernels.hpp"

namespace aa4d::field {

const Kernels& kernels() {
  static const Kernels& chosen = []() -> const Kernels& {
    [[maybe_unused]] const InstructionSet set = choose_instruction_set();
#if defined(__x86_64__)
    if (set == InstructionSet::kAvx512) return kAvx512Kernels;
    if (set == InstructionSet::kAvx2) return kAvx2Kernels;
#endif
    return kPortableKernels;
  }();
  return chosen;
}

const RoundedKernels& rounded_kernels() {
  static const RoundedKernels& chosen = []() -> const RoundedKernels& {
    [[maybe_unused]] const InstructionSet set = choose_instruction_set();
#if defined(__x86_64__)
    if (set == InstructionSet::kAvx512 && __builtin_cpu_supports("avx512bf16")) return kRoundedAvx512Bf16Kernels;
    if (set == InstructionSet::kAvx512) return kRoundedAvx512Kernels;
    if (set == InstructionSet::kAvx2) return kRoundedAvx2Kernels;
#endif
    return kRoundedPortableKernels;
  }();
  return chosen;
}

}  // namespace aa4d::field

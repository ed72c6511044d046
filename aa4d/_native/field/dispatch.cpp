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

}  // namespace aa4d::field

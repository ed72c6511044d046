"""Fused kernels of training and evaluation, each beside a readable torch twin of the same signature.

The public function `f` of a module runs the C++ kernel (float32 on the CPU, any number of threads, the same bits
whatever their number) and its twin `_f` for every other dtype and device.
"""

from __future__ import annotations

import torch
from torch import Tensor


def runs_native(*tensors: Tensor | None) -> bool:
    """True where the C++ kernels can take these tensors."""
    return all(t is None or (t.dtype == torch.float32 and t.device.type == "cpu") for t in tensors)


def plain(tensor: Tensor) -> Tensor:
    """The tensor as the C++ kernels read it: without history, row-major."""
    return tensor.detach().contiguous()

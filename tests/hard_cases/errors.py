"""How far a result is from the truth, as one number."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

Function = Callable[[Sequence[Tensor]], Sequence[Tensor]]


def relative(found: Tensor, truth: Tensor, least: float = 1e-6) -> float:
    """Largest difference over the truth's largest magnitude, or over `least` where that is smaller."""
    if found.shape != truth.shape or not found.isfinite().all():
        return float("inf")
    if not found.numel():
        return 0.0
    return float((found.double() - truth.double()).abs().max() / truth.double().abs().max().clamp_min(least))


def values_and_gradients(f: Function, inputs: Sequence[Tensor]) -> list[Tensor]:
    """Outputs, and the gradients of a fixed random linear form of them by every input that wants one."""
    leaves = [x.detach().clone().requires_grad_(x.requires_grad) for x in inputs]
    outputs = list(f(leaves))
    generator = torch.Generator().manual_seed(7)
    total = sum((y * torch.randn(y.shape, generator=generator).to(y)).sum() for y in outputs)
    assert isinstance(total, Tensor)
    wanted = [x for x in leaves if x.requires_grad]
    return [y.detach() for y in outputs] + list(torch.autograd.grad(total, wanted))


def against_twin(kernel: Function, twin: Function, inputs: Sequence[Tensor], least: float = 1e-6) -> float:
    """float32 through the kernel against float64 through the twin: the worst of all outputs and gradients."""
    found = values_and_gradients(kernel, inputs)
    double = [x.detach().double().requires_grad_(x.requires_grad) for x in inputs]
    truths = values_and_gradients(twin, double)
    return max((relative(a, b, least) for a, b in zip(found, truths, strict=True)), default=0.0)


def refusal(kind: type[Exception], call: Callable[[], object], *words: str) -> float:
    """0 where `call` raises `kind` in one sentence that holds `words`, else infinity."""
    try:
        call()
    except kind as error:
        said = str(error)
        return 0.0 if "\n" not in said and all(word in said for word in words) else float("inf")
    return float("inf")

"""The field's kernels on the device: as exact as on the CPU, of how many launches, and what compiling them gains.

On a GPU the public functions of `aa4d.kernels` run their torch twins. Two switches are tried on these, one kernel at a
time and in a whole iteration: `torch.compile`, and a CUDA graph.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from importlib import import_module
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from aa4d.device import wait_for
from aa4d.kernels.image_loss import _image_loss, image_loss
from aa4d.kernels.local_gaussians import _local_gaussians, local_gaussians
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.plane_penalty import _plane_penalty, plane_penalty
from aa4d.kernels.two_layer import _two_layer, two_layer
from aa4d.training.bench import STANDARD, Workload
from aa4d.training.bench import measure as measure_iteration
from tests.device.asked import Asked, Keep, attempt
from tests.hard_cases.errors import relative, values_and_gradients

BOUND = 2e-5  # relative, of values and gradients; sums of atomic additions come in any order on a GPU
REPEATS = 30
TWINS = ("image_loss", "local_gaussians", "plane_lookup", "plane_penalty", "two_layer")  # modules of aa4d.kernels
Call = Callable[[Sequence[Tensor]], Sequence[Tensor]]


@dataclass(frozen=True)
class Kernel:
    """A public function and its twin as functions of a list of tensors."""

    public: Call
    twin: Call
    inputs: list[Tensor]  # float32 on the CPU; those that learn require a gradient


def measure(asked: Asked, keep: Keep) -> None:
    """What compiles comes last: that is what there may be no time for."""
    device = torch.device(asked.device)
    rows: dict[str, Any] = {}
    of_size = kernels(asked.is_tiny)
    for name, kernel in of_size.items():
        rows[name] = {"exactness": attempt(partial(exactness, kernel, device))}
        rows[name]["twin"] = attempt(partial(cost, kernel.twin, kernel.inputs, device, asked.is_tiny))
        if device.type == "cuda":
            rows[name]["graph"] = attempt(partial(graphed, kernel, device))
        keep("kernels", rows)
    workload = Workload(60, 64, 36) if asked.is_tiny else STANDARD
    seconds = 0.0 if asked.is_tiny else 2.0
    iteration: dict[str, Any] = {"as trained": attempt(partial(_iteration, workload, seconds, device))}
    if device.type == "cpu":
        with twins_alone():
            iteration["twins"] = attempt(partial(_iteration, workload, seconds, device))
    keep("iteration", iteration)
    with compiled_twins():
        iteration["compiled twins"] = attempt(partial(_iteration, workload, seconds, device))
    iteration["compiled twins"]["graphs_compiled"] = torch._dynamo.utils.counters["stats"].get("unique_graphs", 0)
    keep("iteration", iteration)
    for name, kernel in list(of_size.items())[: 1 if asked.is_tiny else None]:  # to trace one takes seconds
        if asked.seconds_left > 0:
            rows[name]["compiled"] = attempt(partial(compiled, kernel, device, asked.is_tiny))
            keep("kernels", rows)


def _iteration(workload: Workload, seconds: float, device: torch.device) -> dict[str, Any]:
    return asdict(measure_iteration(workload, seconds, device))


def kernels(is_tiny: bool) -> dict[str, Kernel]:
    """Of the size of AdaAnchor4D's at 5,000 visible anchors and 320x180 pixels."""
    generator = torch.Generator().manual_seed(0)

    def normal(*shape: int, learned: bool = True) -> Tensor:
        return torch.randn(*shape, generator=generator).requires_grad_(learned)

    count, sides, rows, (height, width) = (50, (4, 8), 5, (16, 24)) if is_tiny else (5000, (64, 128), 25, (180, 320))
    offsets, hidden, features = 10, 64, 32
    planes = [normal(*shape, 16) for side in sides for shape in [(side, side)] * 3 + [(rows, side)] * 3]
    place = (2 * torch.rand(count, 3, generator=generator) - 1) * 0.99
    scores = normal(count, 6, 16)
    outputs = (offsets, 3 * offsets, 7 * offsets)
    networks = [
        tensor
        for out in outputs
        for tensor in (normal(hidden, features), normal(hidden), normal(out, hidden), normal(out))
    ]
    anchors = [
        normal(count, 3, learned=False),
        normal(count, offsets, 3),
        normal(count, 6).detach().exp().requires_grad_(),
        normal(count, offsets),
        normal(count, 3 * offsets),
        normal(count, 7 * offsets),
    ]
    images = [torch.rand(height, width, 3, generator=generator) for _ in range(2)]
    images[0].requires_grad_()
    smooth, constant = [0.1] * len(planes), [1e-3] * len(planes)

    def grouped(tensors: Sequence[Tensor]) -> list[tuple[Tensor, ...]]:
        return [tuple(tensors[i : i + 4]) for i in range(0, len(tensors), 4)]

    def of_anchors(gaussians: Any) -> list[Tensor]:
        return [value for value in vars(gaussians).values() if value is not None]

    return {
        "plane look-up": Kernel(
            lambda x: [look_up(x[:-2], x[-2], 0.4, x[-1])],
            lambda x: [_look_up(x[:-2], x[-2], 0.4, x[-1])],
            [*planes, place, scores],
        ),
        "two-layer networks": Kernel(
            lambda x: list(two_layer(x[0], grouped(x[1:]))),
            lambda x: list(_two_layer(x[0], grouped(x[1:]))),
            [normal(count, features), *networks],
        ),
        "local Gaussians": Kernel(
            lambda x: of_anchors(local_gaussians(*x)), lambda x: of_anchors(_local_gaussians(*x)), anchors
        ),
        "plane penalty": Kernel(
            lambda x: [plane_penalty(x, smooth, constant)], lambda x: [_plane_penalty(x, smooth, constant)], planes
        ),
        "image loss": Kernel(
            lambda x: [image_loss(x[0], x[1], 0.2)[0]], lambda x: [_image_loss(x[0], x[1], 0.2)[0]], images
        ),
    }


def moved(inputs: Sequence[Tensor], device: torch.device, dtype: torch.dtype = torch.float32) -> list[Tensor]:
    return [x.detach().to(device, dtype, copy=True).requires_grad_(x.requires_grad) for x in inputs]


def exactness(kernel: Kernel, device: torch.device) -> dict[str, Any]:
    """The worst relative error of outputs and gradients in float32 on the device, against float64 on the CPU."""
    found = values_and_gradients(kernel.public, moved(kernel.inputs, device))
    truth = values_and_gradients(kernel.twin, moved(kernel.inputs, torch.device("cpu"), torch.float64))
    error = max(relative(a.cpu(), b) for a, b in zip(found, truth, strict=True))
    return {"error": error, "bound": BOUND, "within": error <= BOUND}


def cost(call: Call, inputs: Sequence[Tensor], device: torch.device, is_tiny: bool) -> dict[str, Any]:
    """Milliseconds of value and gradients, the median, and the number of operations that are launched."""
    given = moved(inputs, device)
    wanted = [x for x in given if x.requires_grad]

    def both() -> None:
        torch.autograd.grad(sum(y.sum() for y in call(given)), wanted)

    times = []
    for _ in range(2 if is_tiny else REPEATS):
        wait_for(device)
        started = time.perf_counter()
        both()
        wait_for(device)
        times.append(time.perf_counter() - started)
    counter = _Counter()
    with counter:
        both()
    return {"ms": 1e3 * statistics.median(times), "first_ms": 1e3 * times[0], "operations": counter.count}


class _Counter(TorchDispatchMode):
    """Counts operations that compute something: nearly each is a launch on a GPU."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        is_view = any(alias.alias_info is not None and not alias.alias_info.is_write for alias in func._schema.returns)
        self.count += not is_view and "detach" not in func.name()
        return func(*args, **(kwargs or {}))


def compiled(kernel: Kernel, device: torch.device, is_tiny: bool) -> dict[str, Any]:
    """The same of the twin through `torch.compile`; its first call compiles. The rehearsal only traces it."""
    torch._dynamo.reset()
    call = torch.compile(kernel.twin, dynamic=True, backend=_backend(device))
    given = moved(kernel.inputs, device)
    wanted = [x for x in given if x.requires_grad]
    times = []
    for _ in range(3 if is_tiny else REPEATS):
        wait_for(device)
        started = time.perf_counter()
        torch.autograd.grad(sum(y.sum() for y in call(given)), wanted)
        wait_for(device)
        times.append(time.perf_counter() - started)
    found = values_and_gradients(call, given)
    truth = values_and_gradients(kernel.twin, moved(kernel.inputs, torch.device("cpu"), torch.float64))
    error = max(relative(a.cpu(), b) for a, b in zip(found, truth, strict=True))
    return {"ms": 1e3 * statistics.median(times), "first_ms": 1e3 * times[0], "error": error}


def graphed(kernel: Kernel, device: torch.device) -> dict[str, Any]:
    """The twin's two passes, each replayed as one CUDA graph of fixed shapes."""
    given = tuple(moved(kernel.inputs, device))
    call = torch.cuda.make_graphed_callables(lambda *x: tuple(kernel.twin(list(x))), given)
    return cost(lambda x: list(call(*x)), kernel.inputs, device, is_tiny=False)


def _backend(device: torch.device) -> str:
    return "inductor" if device.type == "cuda" else "eager"


@contextmanager
def twins_alone() -> Iterator[None]:
    """Torch twins on the CPU too: what a GPU runs."""
    modules: list[Any] = [import_module(f"aa4d.kernels.{name}") for name in TWINS]
    kept = [module.runs_native for module in modules]
    for module in modules:
        module.runs_native = lambda *_: False
    try:
        yield
    finally:
        for module, function in zip(modules, kept, strict=True):
            module.runs_native = function


@contextmanager
def compiled_twins() -> Iterator[None]:
    """The twins, through `torch.compile`, for any number of visible units."""
    names = dict(
        zip(TWINS, ("_image_loss", "_local_gaussians", "_look_up", "_plane_penalty", "_two_layer"), strict=True)
    )
    modules = {name: import_module(f"aa4d.kernels.{name}") for name in TWINS}
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    kept = {name: getattr(module, names[name]) for name, module in modules.items()}
    torch._dynamo.reset()
    with twins_alone():
        for name, module in modules.items():
            setattr(module, names[name], torch.compile(kept[name], dynamic=True, backend=_backend(device)))
        try:
            yield
        finally:
            for name, module in modules.items():
                setattr(module, names[name], kept[name])

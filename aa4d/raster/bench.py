"""Times the native rasteriser on random scenes, beside what the machine could do at best: `aa4d bench raster`."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import torch
from rich import box
from rich.console import Console
from rich.table import Table
from torch import Tensor

from aa4d import _native
from aa4d.files import write_json
from aa4d.raster import Camera, Gaussians, Options, rasterize, reference
from aa4d.raster.cutoffs import CUTOFFS, Cutoffs
from aa4d.raster.native import draw

Precision = Literal["fast", "exact"]


@dataclass(frozen=True)
class Scene:
    """Number of Gaussians, their mean size on the screen, and the size of the image."""

    gaussians: int
    width: int
    height: int
    radius_px: float = 12.0  # mean of three standard deviations
    with_reference: bool = False  # whether the torch reference finishes in reasonable time and memory


SCENES = (
    Scene(10_000, 480, 270, with_reference=True),
    Scene(50_000, 640, 360),
    Scene(100_000, 960, 540),
    Scene(400_000, 1280, 720),
)
# Scenes of different sizes and numbers, to tell what a pair costs from what a Gaussian does.
SCALING = tuple(Scene(count, 640, 360, radius) for count in (10_000, 30_000, 90_000) for radius in (3.0, 6.0, 12.0))
ERRORS = Scene(2_000, 160, 90)


@dataclass(frozen=True)
class Row:
    """Measurements of one scene. Times are the best of the repeats unless named otherwise."""

    gaussians: int
    width: int
    height: int
    threads: int
    instruction_set: str
    forward_ms: float
    forward_median_ms: float
    backward_ms: float
    backward_median_ms: float
    pairs: int  # contributions of a Gaussian to a pixel
    pairs_per_second_forward: float
    pairs_per_second_backward: float
    bound_fraction_forward: float  # fraction of the speed of a loop that does a contribution's arithmetic only
    bound_fraction_backward: float
    thread_speedup: float | None  # forward and backward together, against one thread
    reference_ratio: float | None  # how many times longer the torch reference takes, forward and backward together
    peak_mib: float  # resident memory at its highest, above that of the process before the first scene


@dataclass(frozen=True)
class PrecisionRow:
    """What a precision costs on the first of `SCENES`, and what it leaves out on `ERRORS`."""

    precision: Precision
    forward_ms: float
    backward_ms: float
    processor_ms: float  # of both, all threads
    largest_error: float  # of a channel of a pixel, against float64 without cut-offs
    rms_error: float
    gradient_error: float  # relative, in the norm


def bench(
    scenes: Sequence[Scene] = SCENES, repeats: int = 7, json_path: Path | None = None, console: Console | None = None
) -> list[dict[str, object]]:
    """Measure scenes, print a table, and return (and write to `json_path`) one row for each."""
    console = console or Console()
    rows, before = [], _memory_mib("VmRSS")
    for scene in scenes:
        with console.status(_name(scene)):
            rows.append(measure(scene, repeats, before))
    for i, scene in enumerate(scenes):  # last: the reference takes so much memory that all later peaks would show it
        if scene.with_reference:
            reference_ms = 1e3 * sum(min(times) for times in _time(*random_scene(scene), "reference", 1))
            rows[i] = replace(rows[i], reference_ratio=reference_ms / (rows[i].forward_ms + rows[i].backward_ms))
    console.print(_speed_table(rows))
    result = [asdict(row) for row in rows]
    if json_path is not None:
        write_json(json_path, result)
    return result


def bench_precision(repeats: int = 7, console: Console | None = None) -> None:
    """Print what each precision costs, and what error it leaves against float64 without any cut-off."""
    table = Table(
        title="What a precision costs and leaves",
        caption=f"time on {_name(SCENES[0])}; errors on {_name(ERRORS)} against float64 without cut-offs",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for column in (
        "precision",
        "alpha\nfrom",
        "T\ndown to",
        "forward\nms",
        "backward\nms",
        "largest\nerror",
        "rms\nerror",
        "gradient\nerror",
    ):
        table.add_column(column, justify="right")
    for row in measure_precisions(repeats):
        table.add_row(
            row.precision,
            f"{CUTOFFS[row.precision].alpha:.2g}",
            f"{CUTOFFS[row.precision].transmittance:.2g}",
            f"{row.forward_ms:.1f}",
            f"{row.backward_ms:.1f}",
            f"{row.largest_error:.1e}",
            f"{row.rms_error:.1e}",
            f"{row.gradient_error:.1e}",
        )
    (console or Console()).print(table)


def measure_precisions(repeats: int = 7) -> list[PrecisionRow]:
    """One row for each precision."""
    gaussians, camera = random_scene(ERRORS)
    truth, truth_gradient = _image_and_gradient(gaussians, camera, None)
    rows = []
    for precision in get_args(Precision):
        image, gradient = _image_and_gradient(gaussians, camera, precision)
        scene = random_scene(SCENES[0])
        forward, backward = _time(*scene, "native", repeats, precision)
        processor = _time(*scene, "native", repeats, precision, time.process_time)
        error = image.double() - truth
        rows.append(
            PrecisionRow(
                precision,
                1e3 * min(forward),
                1e3 * min(backward),
                1e3 * sum(min(times) for times in processor),
                float(error.abs().max()),
                float(error.square().mean().sqrt()),
                float((gradient.double() - truth_gradient).norm() / truth_gradient.norm()),
            )
        )
    return rows


def bench_scaling(repeats: int = 7, console: Console | None = None) -> None:
    """Fit time = a pairs + b Gaussians + c over scenes that differ in both, and print how well it fits."""
    rows = [measure(scene, repeats, _memory_mib("VmRSS"), single_thread=False) for scene in SCALING]
    inputs = torch.tensor([[row.pairs, row.gaussians, 1.0] for row in rows], dtype=torch.float64)
    table = Table(title=f"Linear fit over {len(rows)} scenes, {rows[0].threads} threads")
    for column in ("pass", "ns per pair", "ns per Gaussian", "ms per image", "R^2", "largest deviation"):
        table.add_column(column, justify="right")
    for name in ("forward", "backward"):
        times = torch.tensor([getattr(row, f"{name}_ms") for row in rows], dtype=torch.float64)
        # Relative deviations are what counts: small scenes would not matter otherwise.
        fit = torch.linalg.lstsq(inputs / times[:, None], torch.ones(len(rows), 1, dtype=torch.float64)).solution[:, 0]
        predicted = inputs @ fit
        r2 = 1 - (times - predicted).square().sum() / (times - times.mean()).square().sum()
        deviation = (predicted / times - 1).abs().max()
        pair, gaussian, image = fit.tolist()
        table.add_row(
            name,
            f"{1e6 * pair:.2f}",
            f"{1e6 * gaussian:.0f}",
            f"{image:.2f}",
            f"{float(r2):.3f}",
            f"{float(deviation):.0%}",
        )
    (console or Console()).print(table)


def random_scene(scene: Scene, seed: int = 0) -> tuple[Gaussians, Camera]:
    """Gaussians spread evenly over the image, 2 to 10 units deep, opacity 0.05 to 0.95, somewhat elongated."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    focal = 0.8 * scene.width
    depth = 2 + 8 * uniform(scene.gaussians, 1)
    sideways = (uniform(scene.gaussians, 2) - 0.5) * torch.tensor([scene.width, scene.height]) / focal * depth
    # exp(s n) has mean exp(s^2 / 2).
    elongation = torch.exp(0.5 * torch.randn(scene.gaussians, 3, generator=generator) - 0.125)
    gaussians = Gaussians(
        means=torch.cat([sideways, depth], dim=-1),
        quaternions=torch.randn(scene.gaussians, 4, generator=generator),
        scales=scene.radius_px / 3 / focal * depth * elongation,
        opacities=0.05 + 0.9 * uniform(scene.gaussians),
        colors=uniform(scene.gaussians, 3),
    )
    K = torch.tensor([[focal, 0, scene.width / 2], [0, focal, scene.height / 2], [0, 0, 1]])
    return gaussians, Camera(torch.eye(4), K, scene.width, scene.height)


def measure(scene: Scene, repeats: int, before_mib: float, single_thread: bool = True) -> Row:
    """Time one scene, forward and backward, with as many threads as torch has, and with one."""
    gc.collect()
    _reset_peak()
    gaussians, camera = random_scene(scene)
    frame, _ = draw(gaussians, camera, torch.zeros(3), Options())
    pairs = frame.count_pairs()
    del frame
    threads = torch.get_num_threads()
    forward, backward = _time(gaussians, camera, "native", repeats)
    peak = _memory_mib("VmHWM") - before_mib
    bound_forward, bound_backward = (_arithmetic_seconds(is_backward, pairs) for is_backward in (False, True))
    speedup = None
    if single_thread and threads > 1:
        torch.set_num_threads(1)
        try:
            single = sum(min(times) for times in _time(gaussians, camera, "native", repeats))
        finally:
            torch.set_num_threads(threads)
        speedup = single / (min(forward) + min(backward))
    return Row(
        gaussians=scene.gaussians,
        width=scene.width,
        height=scene.height,
        threads=threads,
        instruction_set=_native.raster.instruction_set(),
        forward_ms=1e3 * min(forward),
        forward_median_ms=1e3 * statistics.median(forward),
        backward_ms=1e3 * min(backward),
        backward_median_ms=1e3 * statistics.median(backward),
        pairs=pairs,
        pairs_per_second_forward=pairs / min(forward),
        pairs_per_second_backward=pairs / min(backward),
        bound_fraction_forward=bound_forward / min(forward),
        bound_fraction_backward=bound_backward / min(backward),
        thread_speedup=speedup,
        reference_ratio=None,
        peak_mib=peak,
    )


def _speed_table(rows: Sequence[Row]) -> Table:
    """Two lines for each scene, to fit a terminal of 80 columns."""
    first = rows[0]
    table = Table(
        title=f"Native rasterizer, {first.instruction_set}, {first.threads} threads",
        caption="speed-up: both passes, against one thread; torch: how many times longer its reference takes",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for name in (
        "Gaussians",
        "pass",
        "best\nms",
        "median\nms",
        "10^9\npairs/s",
        "of the\nbound",
        "speed\n-up",
        "torch",
    ):
        table.add_column(name, justify="left" if name == "pass" else "right")
    table.add_column("peak\nMiB", justify="right")
    for row in rows:
        table.add_row(
            str(row.gaussians),
            "forward",
            f"{row.forward_ms:.1f}",
            f"{row.forward_median_ms:.1f}",
            f"{row.pairs_per_second_forward / 1e9:.2f}",
            f"{row.bound_fraction_forward:.2f}",
            "" if row.thread_speedup is None else f"{row.thread_speedup:.2f}",
            "" if row.reference_ratio is None else f"{row.reference_ratio:.0f}",
            f"{row.peak_mib:.0f}",
        )
        table.add_row(
            f"{row.width}x{row.height}",
            "backward",
            f"{row.backward_ms:.1f}",
            f"{row.backward_median_ms:.1f}",
            f"{row.pairs_per_second_backward / 1e9:.2f}",
            f"{row.bound_fraction_backward:.2f}",
            end_section=True,
        )
    return table


def _name(scene: Scene) -> str:
    return f"{scene.gaussians} at {scene.width}x{scene.height}"


def _leaves(gaussians: Gaussians) -> dict[str, Tensor]:
    given: dict[str, Tensor] = {name: value for name, value in vars(gaussians).items() if value is not None}
    return {name: value.detach().clone().requires_grad_() for name, value in given.items()}


def _weights(camera: Camera) -> Tensor:
    return torch.randn(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(1))


def _image_and_gradient(gaussians: Gaussians, camera: Camera, precision: Precision | None) -> tuple[Tensor, Tensor]:
    """A picture, and the gradient of all means, scales and opacities in one; float64 without cut-offs for None."""
    dtype = torch.float64 if precision is None else torch.float32
    leaves = {name: value.to(dtype).detach().requires_grad_() for name, value in _leaves(gaussians).items()}
    background = torch.zeros(3, dtype=dtype)
    if precision is None:
        image = reference.rasterize(Gaussians(**leaves), camera, background, Options(), Cutoffs(1e-15, 0))
    else:
        image = rasterize(Gaussians(**leaves), camera, background=background, precision=precision)
    image.color.backward(_weights(camera).to(dtype))
    parts = (leaves[name].grad for name in ("means", "scales", "opacities"))
    return image.color.detach(), torch.cat([part.flatten() for part in parts if part is not None])


def _time(
    gaussians: Gaussians,
    camera: Camera,
    backend: Literal["native", "reference"],
    repeats: int,
    precision: Precision = "fast",
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[list[float], list[float]]:
    """Seconds, by this clock, of each forward and each backward pass, after one that is not counted."""
    leaves, weights, background = _leaves(gaussians), _weights(camera), torch.zeros(3)
    forward, backward = [], []
    warm_up = 1 if backend == "native" else 0
    for _ in range(repeats + warm_up):
        for leaf in leaves.values():
            leaf.grad = None
        start = clock()
        image = rasterize(Gaussians(**leaves), camera, background=background, backend=backend, precision=precision)
        middle = clock()
        image.color.backward(weights)
        forward.append(middle - start)
        backward.append(clock() - middle)
    return forward[warm_up:], backward[warm_up:]


def _arithmetic_seconds(is_backward: bool, pairs: int) -> float:
    """The least time that the arithmetic of so many contributions takes on all threads."""
    sample = 5_000_000  # about a millisecond: short enough to run undisturbed once in a while
    times = []
    for _ in range(50):
        start = time.perf_counter()
        _native.raster.arithmetic(is_backward, sample, torch.get_num_threads())
        times.append(time.perf_counter() - start)
    return min(times) * pairs / sample


def _reset_peak() -> None:
    """Let Linux count the process's peak of resident memory anew; elsewhere the peak is that of the whole process."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def _memory_mib(field: str) -> float:
    """A field of /proc/self/status in MiB; NaN where there is no such file."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field + ":"))

"""Times one training iteration and one rendered frame on a made-up scene, part by part: `aa4d bench train`."""

from __future__ import annotations

import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from rich.console import Console
from rich.table import Table
from torch.autograd import DeviceType
from torch.autograd.profiler import profile
from torch.profiler import ProfilerActivity
from torch.profiler import profile as device_profile

from aa4d import _native
from aa4d.capture.reader import Capture
from aa4d.capture.schema import Frame, PinholeCamera
from aa4d.device import wait_for
from aa4d.field.mlp import use_arithmetic
from aa4d.files import write_json
from aa4d.identity import Identity
from aa4d.kernels.two_layer import ARITHMETIC
from aa4d.methods import DEFAULT, method_of, presets_of
from aa4d.methods.rendering import render
from aa4d.methods.scene_model import SceneModel
from aa4d.training.checkpoints import TrainingState
from aa4d.training.frames import training_frames
from aa4d.training.trainer import Run

FRAMES = 16
WARM_UP = 5
PROFILED = 5
ALTERNATED = 8  # iterations in each arithmetic

# Names of profiled operations, by how they begin; what fits none is OTHER.
PARTS = {
    "networks": ("_TwoLayer", "aten::mm", "aten::addmm"),
    "feature planes": ("_LookUp", "_PlanePenalty"),
    "decoding": ("_LocalGaussians",),
    "rasteriser": ("_Rasterize",),
    "image loss": ("_ImageLoss",),
    "Adam": ("aten::_fused_adam_", "Optimizer."),
}
OTHER = "rest of torch"
# The same by what the names of a GPU's kernels hold, in lower case; the first that fits counts.
DEVICE_PARTS = {
    "rasteriser": ("gsplat", "rasterize_to_pixels", "projection_ewa", "intersect", "radixsort"),
    "Adam": ("adam",),
    "feature planes": ("grid_sampler",),
    "image loss": ("conv",),
    "networks": ("gemm", "cutlass", "cublas", "gemv"),
    "copies": ("memcpy", "memset", "copy_kernel"),
}
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Workload:
    anchors: int
    width: int
    height: int


STANDARD = Workload(5_000, 320, 180)
GROWTH = (
    *(replace(STANDARD, anchors=count) for count in (1_000, 5_000, 20_000, 50_000)),
    *(replace(STANDARD, width=width, height=width * 9 // 16) for width in (160, 640, 960)),
)


@dataclass(frozen=True)
class Row:
    """What was measured of one workload; medians."""

    anchors: int  # of 10 Gaussians, all in view
    width: int
    height: int
    iterations_per_second: float  # of the fine stage
    render_fps: float  # deform, decode and rasterise
    peak_mib: float  # at its highest: resident memory of the whole process, or what torch took of a GPU's
    processor_ms: dict[str, float]  # of an iteration, all threads, the least, in each arithmetic of the networks
    kernels_ms: float  # of an iteration: the sum of all profiled operations, on a GPU of its kernels
    parts: dict[str, float]  # and the share of each part in it
    launches: float | None = None  # of kernels and copies, in an iteration on a GPU

    @property
    def iteration_ms(self) -> float:
        return 1e3 / self.iterations_per_second


def bench(
    json_path: Path | None = None,
    console: Console | None = None,
    *,
    standard: Workload = STANDARD,
    growth: Sequence[Workload] = GROWTH,
    seconds: float = 3.0,
    device: torch.device = CPU,
) -> dict[str, object]:
    """Measure, print two tables, and return (and write to `json_path`) the standard workload and the growth.

    Args:
        seconds: of timed iterations, and again of timed frames, for each workload.
    """
    console = console or Console()
    os.environ.setdefault("KINETO_LOG_LEVEL", "6")  # the profiler says on stderr when it starts and stops
    rows: dict[Workload, Row] = {}

    def measured(workload: Workload) -> Row:
        if workload not in rows:
            with console.status(f"{workload.anchors} anchors at {workload.width}x{workload.height}"):
                rows[workload] = measure(workload, seconds, device)
        return rows[workload]

    row = measured(standard)
    console.print(_summary(row), highlight=False)
    console.print(_parts_table(row))
    if growth:
        console.print(_growth_table([measured(workload) for workload in growth]))
    result = {
        **asdict(row),
        "iteration_ms": row.iteration_ms,
        "threads": torch.get_num_threads(),
        "instruction_set": _native.field.instruction_set(),
        "growth": [asdict(rows[workload]) for workload in growth],
    }
    if json_path is not None:
        write_json(json_path, json.loads(json.dumps(result)))
    return result


def measure(workload: Workload, seconds: float, device: torch.device = CPU, method: str = DEFAULT) -> Row:
    """Train the first moving stage of a method's preset `paper` on a made-up capture of this size."""
    _forget_peak(device)
    with tempfile.TemporaryDirectory() as folder:
        run, state = prepare(workload, Path(folder), device, method)

        def iterate() -> None:
            run.step(state)
            state.iteration += 1

        def draw() -> None:
            state.iteration += 1
            view = run.frames.views[state.iteration % len(run.frames.views)]
            with torch.no_grad():
                render(state.model, view.t, view.camera, run.frames.background)

        iteration_seconds = _median_seconds(iterate, seconds, device)
        peak = _peak_mib(device)
        frame_seconds = _median_seconds(draw, seconds, device)
        processor_ms = _processor_ms(state.model, iterate)
        times, launches = _profiled(iterate) if device.type == "cpu" else _profiled_on_device(iterate)
    total = sum(times.values())
    return Row(
        anchors=len(state.model),
        width=workload.width,
        height=workload.height,
        iterations_per_second=1 / iteration_seconds,
        render_fps=1 / frame_seconds,
        peak_mib=peak,
        processor_ms=processor_ms,
        kernels_ms=total,
        parts={name: value / total for name, value in times.items()},
        launches=launches,
    )


def _profiled(iterate: Callable[[], None]) -> tuple[dict[str, float], None]:
    """Milliseconds of an iteration in each of `PARTS`, and in the rest."""
    with profile(use_kineto=False) as profiler:
        for _ in range(PROFILED):
            iterate()
    times = dict.fromkeys((*PARTS, OTHER), 0.0)
    for event in profiler.key_averages():
        part = next((name for name, starts in PARTS.items() if event.key.startswith(starts)), OTHER)
        times[part] += event.self_cpu_time_total / PROFILED / 1e3
    return times, None


def _profiled_on_device(iterate: Callable[[], None]) -> tuple[dict[str, float], float]:
    """Milliseconds of an iteration in the kernels of each of `DEVICE_PARTS` and the rest, and how many are launched."""
    with device_profile(activities=[ProfilerActivity.CPU, ProfilerActivity.CUDA]) as profiler:
        for _ in range(PROFILED):
            iterate()
        torch.cuda.synchronize()
    times, launches = dict.fromkeys((*DEVICE_PARTS, OTHER), 0.0), 0.0
    for event in profiler.key_averages():
        # A span that torch names, as it does an optimiser's step, is shown on the device too, and is no kernel.
        if event.device_type != DeviceType.CUDA or event.is_user_annotation:
            continue
        name = event.key.lower()
        part = next((part for part, words in DEVICE_PARTS.items() if any(word in name for word in words)), OTHER)
        times[part] += event.self_device_time_total / PROFILED / 1e3
        launches += event.count / PROFILED
    return times, launches


def prepare(workload: Workload, folder: Path, device: torch.device, method: str) -> tuple[Run, TrainingState]:
    """A moving stage past its beginning, when statistics are gathered and no unit comes or goes.

    Of a method of free Gaussians, a unit is one of them.
    """
    spacing_px = (workload.width * workload.height / workload.anchors) ** 0.5
    # Every point becomes a unit.
    settings = replace(presets_of(method)["paper"], voxel_px=0.5 * spacing_px)  # type: ignore[call-arg]
    capture = _capture(workload, spacing_px, folder)
    settings = method_of(method).resolved(settings, len(capture.frames))
    run = Run(training_frames(capture, device), folder, settings)
    state = run.initial_state()
    run.enter(state, run.schedule.first_moving)
    with torch.no_grad():  # as after some training: half of an anchor's Gaussians are visible, none like another
        for name, parameter in state.model.named_parameters():
            if name == "anchors.feature":
                parameter.normal_()
            elif name == "anchors.offset":
                parameter.normal_(0, 0.7)
    state.iteration = settings.densification.statistics_from + 1
    return run, state


def _capture(workload: Workload, spacing_px: float, folder: Path) -> Capture:
    """A drone that looks straight down from one metre, so that a pixel is 1 / focal length; focal length = width."""
    width, height = workload.width, workload.height
    generator = np.random.default_rng(0)
    frames = []
    for i in range(FRAMES):
        viewmat = np.diag([1.0, -1.0, -1.0, 1.0])
        viewmat[:3, 3] = [0.02 * (i / (FRAMES - 1) - 0.5), 0.0, 1.0]
        small = generator.integers(0, 256, (height // 8, width // 8, 3), dtype=np.uint8)
        Image.fromarray(small).resize((width, height), Image.Resampling.BICUBIC).save(folder / f"{i}.png")
        frames.append(Frame(str(i), f"{i}.png", None, i / 10, i / (FRAMES - 1), "train" if i % 8 else "test", viewmat))
    columns = round(width / spacing_px)
    rows = round(workload.anchors / columns)
    place = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1).reshape(-1, 2)
    ground = (place / [columns, rows] - 0.5) * [1.0, height / width]
    points = np.column_stack([ground, 0.01 * generator.standard_normal(len(ground))])
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    colors = np.zeros((len(points), 3), np.uint8)
    camera, nobody = PinholeCamera(width, height, K), Identity("capture", "bench")
    return Capture(folder, "bench", nobody, 10.0, camera, tuple(frames), points, colors, None)


def _median_seconds(run: Callable[[], None], seconds: float, device: torch.device) -> float:
    """The median over as many calls as fit into `seconds`, at least ten, after a warm-up."""
    for _ in range(WARM_UP):
        run()
    wait_for(device)
    times: list[float] = []
    while len(times) < 10 or sum(times) < seconds:
        started = time.perf_counter()
        run()
        wait_for(device)
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def _processor_ms(model: SceneModel, run: Callable[[], None]) -> dict[str, float]:
    """The least in each arithmetic, by turns, so that what else the machine does meets all of them."""
    times: dict[str, list[float]] = {name: [] for name in ARITHMETIC}
    for _ in range(ALTERNATED):
        for name in ARITHMETIC:
            use_arithmetic(model, name)
            started = time.process_time()
            run()
            times[name].append(1e3 * (time.process_time() - started))
    use_arithmetic(model, ARITHMETIC[0])
    return {name: min(of_name) for name, of_name in times.items()}


def _forget_peak(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return  # the peak is then that of the largest workload so far


def _peak_mib(device: torch.device) -> float:
    """NaN where there is no such file."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 2**20
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))


def _summary(row: Row) -> str:
    return (
        f"{row.anchors} anchors of 10 Gaussians, {row.width}x{row.height}, {torch.get_num_threads()} threads, "
        f"{_native.field.instruction_set()}:\n"
        f"{row.iterations_per_second:.1f} iterations/s ({row.iteration_ms:.1f} ms, "
        f"{row.iteration_ms / row.kernels_ms:.2f} x the sum of its kernels),\n"
        f"{row.render_fps:.0f} rendered frames/s, peak {row.peak_mib:.0f} MiB,\n"
        f"{_by_arithmetic(row)} ms of the processor an iteration"
    )


def _by_arithmetic(row: Row) -> str:
    return ", ".join(f"{name} {ms:.1f}" for name, ms in row.processor_ms.items())


def _parts_table(row: Row) -> Table:
    table = Table()
    table.add_column("part of an iteration")
    table.add_column("ms", justify="right")
    table.add_column("share", justify="right")
    for name, share in sorted(row.parts.items(), key=lambda part: -part[1]):
        table.add_row(name, f"{share * row.kernels_ms:.2f}", f"{share:.0%}")
    return table


def _growth_table(rows: Sequence[Row]) -> Table:
    table = Table(title="How it grows")
    for column in ("anchors", "image", "iter./s", "ms", "fps", "peak MiB", "largest part"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in rows:
        part, share = max(row.parts.items(), key=lambda item: item[1])
        table.add_row(
            f"{row.anchors}",
            f"{row.width}x{row.height}",
            f"{row.iterations_per_second:.1f}",
            f"{row.iteration_ms:.1f}",
            f"{row.render_fps:.0f}",
            f"{row.peak_mib:.0f}",
            f"{part} {share:.0%}",
        )
    return table

"""The precision ladder: error and time of every kernel in float64, float32 and bfloat16.

    python -m aa4d.stress.precision --json ladder.json --plot ladder.png

What has a fused kernel is measured as the kernel and as its torch twin. A twin in bfloat16 keeps every number in it,
but where the look-up interpolates; the networks' kernel rounds the factors of products only. Times are of the
processor, forward and backward, the least of the repeats: other programs on the machine alter them little.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import torch
from matplotlib.figure import Figure
from torch import Tensor
from tyro.conf import arg

from aa4d import _native
from aa4d.errors import InputError
from aa4d.experiments.program import run_as_program
from aa4d.files import whole_file, write_json
from aa4d.kernels.image_loss import _image_loss, image_loss
from aa4d.kernels.local_gaussians import _local_gaussians, local_gaussians
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.plane_penalty import _plane_penalty, plane_penalty
from aa4d.kernels.two_layer import Layers, _two_layer, two_layer
from aa4d.methods.adaanchor4d.warping import CoordinateWarp, density_adaptive_boundaries
from aa4d.motion.groups import carry, pose_of
from aa4d.raster import Camera, Gaussians, Options, rasterize, reference
from aa4d.raster.bench import Scene, random_scene
from aa4d.raster.cutoffs import CUTOFFS

Function = Callable[[Sequence[Tensor]], Sequence[Tensor]]

DTYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16}
ANCHORS = 4000
T = 0.37


@dataclass(frozen=True)
class Subject:
    """A piece of training: float32 inputs, which want gradients, and what becomes of them."""

    name: str
    inputs: list[Tensor]
    twin: Function
    kernels: dict[str, Function]  # by arithmetic


@dataclass(frozen=True)
class Row:
    """One arithmetic of one subject. Errors are relative, in the norm, against the twin in float64."""

    subject: str
    arithmetic: str  # of `DTYPES`
    by: str  # kernel or torch
    value_error: float | None  # the worst output; None where something is not finite
    gradient_error: float | None  # the worst input; likewise
    ms: float


def subjects(anchors: int = ANCHORS) -> Iterator[Subject]:
    torch.manual_seed(0)
    yield _rasteriser(anchors)
    yield _plane_lookup(anchors)
    yield _plane_penalty_of(anchors)
    yield _networks("networks: weights", anchors, 32, [(256, 96)], T)
    yield _networks("networks: heads", anchors, 128, [(128, 3), (128, 32)], None)
    yield _networks("networks: geometry", anchors, 32, [(128, 30)], T)
    yield _networks("networks: decoders", anchors, 35, [(32, 10), (32, 30), (32, 70)], None)
    yield _decode(anchors)
    yield _image(anchors)
    yield _warp(anchors)
    yield _rigid_groups(anchors)


def _rasteriser(anchors: int) -> Subject:
    # Of few Gaussians, which the torch reference draws in reasonable time.
    gaussians, camera = random_scene(Scene(anchors // 10, 80, 45, radius_px=6.0))
    names = ("means", "quaternions", "scales", "opacities", "colors")

    def twin(x: Sequence[Tensor]) -> list[Tensor]:
        given = Gaussians(**dict(zip(names, x, strict=True)))
        cast = Camera(camera.viewmat.to(x[0]), camera.K.to(x[0]), camera.width, camera.height)
        return [reference.rasterize(given, cast, x[0].new_zeros(3), Options(), CUTOFFS["exact"]).color]

    def kernel(x: Sequence[Tensor]) -> list[Tensor]:
        given = Gaussians(**dict(zip(names, x, strict=True)))
        return [rasterize(given, camera, background=torch.zeros(3), precision="exact", backend="native").color]

    return Subject("rasteriser", [getattr(gaussians, name) for name in names], twin, {"float32": kernel})


def _plane_lookup(anchors: int) -> Subject:
    sizes = [(r, r) if i < 3 else (25, r) for r in (64, 128) for i in range(6)]
    planes = [torch.rand(*size, 16) + 0.5 for size in sizes]
    u, scores = torch.rand(anchors, 3) * 2 - 1, torch.randn(anchors, 6, 16)
    return Subject(
        "plane look-up",
        [*planes, scores],
        lambda x: [_look_up(x[:-1], u.to(x[0]), T, x[-1])],
        {"float32": lambda x: [look_up(x[:-1], u, T, x[-1])]},
    )


def _plane_penalty_of(_anchors: int) -> Subject:
    planes = [torch.rand(128, 128, 16) + 0.5 for _ in range(6)]
    weights = [0.3] * 6, [0.1] * 6
    return Subject(
        "plane penalty",
        planes,
        lambda x: [_plane_penalty(x, *weights)],
        {"float32": lambda x: [plane_penalty(x, *weights)]},
    )


def _networks(name: str, anchors: int, inputs: int, sizes: Sequence[tuple[int, int]], t: float | None) -> Subject:
    layers: list[Tensor] = []
    for hidden, outputs in sizes:
        columns = inputs + (t is not None)
        layers += [torch.randn(hidden, columns) / columns**0.5, torch.randn(hidden)]
        layers += [torch.randn(outputs, hidden) / hidden**0.5, torch.randn(outputs)]

    def run(f: Callable[..., tuple[Tensor, ...]], *arithmetic: str) -> Function:
        def grouped(x: Sequence[Tensor]) -> tuple[Tensor, ...]:
            networks: list[Layers] = [(x[i], x[i + 1], x[i + 2], x[i + 3]) for i in range(1, len(x), 4)]
            return f(x[0], networks, t, *arithmetic)

        return grouped

    kernels = {name: run(two_layer, name) for name in ("float32", "bfloat16")}
    return Subject(name, [torch.randn(anchors, inputs), *layers], run(_two_layer), kernels)


def _decode(anchors: int) -> Subject:
    flat = ((anchors, 6), (anchors, 10), (anchors, 30), (anchors, 70))
    inputs = [torch.randn(shape) for shape in ((anchors, 3), (anchors, 10, 3), *flat)]
    inputs[2] = inputs[2].exp()

    def parts(f: Callable[..., Gaussians]) -> Function:
        return lambda x: [value for value in vars(f(*x)).values() if value is not None]

    return Subject("decode", inputs, parts(_local_gaussians), {"float32": parts(local_gaussians)})


def _image(_anchors: int) -> Subject:
    target = torch.rand(180, 320, 3)
    image = (target + 0.1 * torch.randn_like(target)).clamp(0, 1)
    return Subject(
        "image loss",
        [image],
        lambda x: _image_loss(x[0], target.to(x[0]), 0.2)[:1],
        {"float32": lambda x: image_loss(x[0], target, 0.2)[:1]},
    )


def _warp(anchors: int) -> Subject:
    u = torch.randn(anchors, 3).mul(0.3).clamp(-1, 1)
    warp = CoordinateWarp(64)
    warp.boundaries.copy_(density_adaptive_boundaries(u, 64, 1.5, 1.0, 0.2, 0.8))

    def run(x: Sequence[Tensor]) -> list[Tensor]:
        cast = CoordinateWarp(64)
        cast.boundaries = warp.boundaries.to(x[0])
        return [cast(x[0])]

    return Subject("DACW", [u], run, {})


def _rigid_groups(anchors: int) -> Subject:
    groups, K = 12, 10
    of = torch.arange(anchors) % groups
    position, heading = torch.randn(groups, 3), torch.randn(groups)
    means, quaternions = torch.randn(anchors * K, 3) * 0.05, torch.randn(anchors * K, 4)

    def run(x: Sequence[Tensor]) -> list[Tensor]:
        rest = Gaussians(x[0], x[1], x[0].new_ones(len(x[0]), 3), x[0].new_ones(len(x[0])), x[0].new_ones(len(x[0]), 3))
        pose = pose_of(x[2], x[3], x[0].new_tensor([0.0, 0.0, 1.0])).at(of)
        carried = carry(rest, anchors, torch.arange(anchors), pose, x[0].new_ones(anchors))
        return [carried.means, carried.quaternions]

    return Subject("rigid groups", [means, quaternions, position, heading], run, {})


def values_and_gradients(f: Function, inputs: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
    """Outputs, and gradients of a fixed random linear form of them by the inputs."""
    leaves = [x.detach().clone().requires_grad_() for x in inputs]
    outputs = list(f(leaves))
    generator = torch.Generator().manual_seed(1)
    pushes = [torch.randn(y.shape, generator=generator).to(y.dtype) for y in outputs]
    gradients = torch.autograd.grad(outputs, leaves, pushes)
    return [y.detach() for y in outputs], list(gradients)


def measure(subject: Subject, repeats: int) -> Iterator[Row]:
    """Every arithmetic of a subject, the most exact first."""
    truth = values_and_gradients(subject.twin, [x.double() for x in subject.inputs])
    ways = [(name, "torch", subject.twin, dtype) for name, dtype in DTYPES.items()]
    ways += [(name, "kernel", kernel, torch.float32) for name, kernel in subject.kernels.items()]
    for arithmetic, by, f, dtype in sorted(ways, key=lambda way: list(DTYPES).index(way[0])):
        inputs = [x.to(dtype) for x in subject.inputs]
        found = values_and_gradients(f, inputs)
        value, gradient = (worst(ours, theirs) for ours, theirs in zip(found, truth, strict=True))
        seconds = min(_seconds(f, inputs) for _ in range(repeats))
        yield Row(subject.name, arithmetic, by, value, gradient, 1e3 * seconds)


def worst(found: Sequence[Tensor], truth: Sequence[Tensor]) -> float | None:
    """The largest relative error in the norm; None where something is not finite."""
    errors = [(a.double() - b).norm() / b.norm().clamp_min(1e-12) for a, b in zip(found, truth, strict=True)]
    return float(max(errors)) if all(error.isfinite() for error in errors) else None


def _seconds(f: Function, inputs: Sequence[Tensor]) -> float:
    start = time.process_time()
    values_and_gradients(f, inputs)
    return time.process_time() - start


MARKS = {("float64", "torch"): "s", ("float32", "torch"): "o", ("bfloat16", "torch"): "^"}
MARKS |= {("float32", "kernel"): "*", ("bfloat16", "kernel"): "P"}


def figure(rows: Sequence[Row]) -> Figure:
    """Gradient error over time: a colour for each subject, a mark for each arithmetic."""
    picture = Figure(figsize=(9, 5.5), layout="constrained")
    axes = picture.add_subplot()
    names = list(dict.fromkeys(row.subject for row in rows))
    for i, name in enumerate(names):
        own = [row for row in rows if row.subject == name]
        shown = [(row, row.gradient_error) for row in own if row.gradient_error]  # of float64 it is 0
        color = f"C{i % 10}" if i < 10 else "k"
        axes.plot([row.ms for row, _ in shown], [error for _, error in shown], "-", color=color, alpha=0.25)
        for row, error in shown:
            axes.plot(row.ms, error, MARKS[row.arithmetic, row.by], color=color, markersize=8)
        axes.plot([], [], "-", color=color, label=name)
    for (arithmetic, by), mark in MARKS.items():
        if arithmetic != "float64":
            axes.plot([], [], mark, color="0.4", label=f"{arithmetic}, {by}")
    axes.set(xscale="log", yscale="log", xlabel="processor time, forward and backward, ms")
    axes.set_ylabel("error of the gradients, relative to float64")
    axes.grid(alpha=0.3)
    picture.legend(loc="outside right upper", fontsize=8)
    return picture


def _shown(error: float | None) -> str:
    return "not finite" if error is None else f"{error:.1e}"


def main(
    json: Annotated[Path | None, arg(metavar="PATH", help="File to write the rows to.")] = None,
    plot: Annotated[Path | None, arg(metavar="PATH", help="PNG to draw error over time into.")] = None,
    repeats: Annotated[int, arg(help="Runs of each; the fastest counts.")] = 7,
) -> None:
    """Measure every kernel in every arithmetic."""
    if repeats < 1:
        raise InputError(f"--repeats {repeats}: must be at least 1")
    for option, path in (("--json", json), ("--plot", plot)):
        if path is not None and not path.parent.is_dir():
            raise InputError(f"{option} {path}: there is no folder {path.parent}")
    torch.set_num_threads(1)
    if not _native.field.bfloat16_in_hardware():
        print("this processor has no bfloat16 products (AVX-512 BF16): those of the kernels are made of float32's")
    rows = []
    for subject in subjects():
        for row in measure(subject, repeats):
            rows.append(row)
            print(
                f"{row.subject:20} {row.arithmetic:9} {row.by:7} values {_shown(row.value_error)}  "
                f"gradients {_shown(row.gradient_error)}  {row.ms:8.2f} ms",
                flush=True,
            )
    if json is not None:
        write_json(json, {"rows": [asdict(row) for row in rows]})
    if plot is not None:
        with whole_file(plot) as temporary:
            figure(rows).savefig(temporary, format="png", dpi=110)


if __name__ == "__main__":
    run_as_program(main)

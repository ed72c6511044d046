"""Anchors and their decoding into Gaussians: saturated decoders, lone and coincident anchors."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from aa4d.anchors.canonical import spacing, voxel_centres
from aa4d.anchors.visibility import in_view
from aa4d.kernels.local_gaussians import _local_gaussians, local_gaussians
from aa4d.raster.types import Camera
from aa4d.stress.cases import Part
from tests.hard_cases.errors import Function, against_twin, refusal, relative

PART = Part("anchors")


def outputs(anchors: int, offsets: int, size: float = 1.0) -> list[Tensor]:
    """What the decoders say for `anchors` anchors, before tanh and sigmoid."""
    generator = torch.Generator().manual_seed(4)
    shapes = [(anchors, 3), (anchors, offsets, 3), (anchors, 6)]
    shapes += [(anchors, offsets), (anchors, 3 * offsets), (anchors, 7 * offsets)]
    inputs = [torch.randn(shape, generator=generator) for shape in shapes]
    inputs[2] = inputs[2].exp()
    for raw in inputs[3:]:
        raw.mul_(size)
    return [x.requires_grad_() for x in inputs]


def parts(f: object) -> Function:
    return lambda x: [value for value in vars(f(*x)).values() if value is not None]  # type: ignore[operator]


def decoding_error(inputs: list[Tensor], least: float = 1e-6) -> float:
    return against_twin(parts(local_gaussians), parts(_local_gaussians), inputs, least)


@PART.case(
    why="tanh and sigmoid lose their bits near zero and their slope far from it",
    done="a series near zero, e^-|x| elsewhere: nothing overflows",
    bound=1e-5,
    each={f"{size:g}": size for size in (1e-30, 1e-6, 1e-2, 30.0, 1e4, 1e30)},
)
def decoder_outputs_of_size(size: float) -> float:
    # A saturated sigmoid's slope, c (1 - c), has the absolute accuracy of c: against the slope of one that is not.
    return decoding_error(outputs(300, 10, size), 0.1)


@PART.case(
    why="no anchors, no offsets, one of each",
    done="empty Gaussians",
    bound=1e-5,
    each={f"{n} x {k}": (n, k) for n, k in ((0, 10), (1, 1), (5, 0), (2, 64))},
)
def odd_numbers(size: tuple[int, int]) -> float:
    return decoding_error(outputs(*size))


@PART.case(why="more offsets than the kernel's scratch holds", done="refused in one sentence")
def sixty_five_offsets() -> float:
    return refusal(ValueError, lambda: local_gaussians(*outputs(2, 65)), "64 offsets")


@PART.case(
    why="an opacity of 1e-7 beside one of 60: 1 - e^-2x cancels",
    done="relative accuracy of every opacity and color by itself",
    bound=3e-7,
)
def small_opacities_keep_their_bits() -> float:
    raw = torch.tensor([[1e-7, 1e-3, 0.2499, 0.2501, 1.0, 60.0, -60.0, -1e-3, 3e38]])
    color, zeros = raw.repeat(1, 3), torch.zeros(1, 9, 3)
    gaussians = local_gaussians(zeros[0, :1], zeros, torch.ones(1, 6), raw, color, torch.zeros(1, 63))
    opacities, colors = raw.double().tanh().clamp_min(0)[0], torch.sigmoid(color.double()[0])
    off = [(gaussians.opacities.double() - opacities).abs() / opacities.clamp_min(1e-30)]
    off += [(gaussians.colors.view(-1).double() - colors).abs() / colors.clamp_min(1e-20)]
    return max(float(part.max()) for part in off)


@PART.case(
    why="positions of 1e6 beside offsets of 1e-6, and the reverse",
    done="one fused multiply-add an axis",
    bound=1e-6,
    each={f"{size:g}": size for size in (1e-6, 1e6)},
)
def positions_of_size(size: float) -> float:
    inputs = outputs(50, 4)
    with torch.no_grad():
        inputs[0] *= size
        inputs[1] /= size
    return decoding_error(inputs, 1e-3)


@PART.case(why="one NaN of one anchor", done="seen in its own Gaussian, and nowhere else")
def nan_stays_where_it_is() -> float:
    inputs = [x.detach() for x in outputs(9, 4)]
    inputs[3][4, 2] = math.nan
    bad = local_gaussians(*inputs).opacities.isnan().nonzero()[:, 0].tolist()
    return 0.0 if bad == [4 * 4 + 2] else math.inf


@PART.case(why="coincident or lone points: the logarithm of a distance of zero", done="at least a floor")
def spacing_of_duplicates() -> float:
    found = [spacing(np.zeros((5, 3)), 1e-3), spacing(np.zeros((1, 3)), 1e-3), spacing(np.zeros((0, 3)), 1e-3)]
    return max(float(np.abs(each - 1e-3).max(initial=0)) for each in found)


@PART.case(
    why="duplicated points among far ones: 1e5 points in one place",
    done="one centre a voxel, whatever their number",
)
def voxels_of_duplicates() -> float:
    points = np.concatenate([np.full((100_000, 3), 0.04), np.full((3, 3), 9_999.96)])
    return float(abs(len(voxel_centres(points, 0.1)) - 2))


@PART.case(why="anchors at and behind the camera's plane", done="kept at the plane, left out behind it")
def anchors_at_the_cameras_plane() -> float:
    K = torch.tensor([[10.0, 0, 5], [0, 10, 5], [0, 0, 1]])
    position = torch.tensor([[0, 0, 1.0], [0, 0, 0.0], [0, 0, -1.0], [9.0, 0, 1.0], [0.6, -0.6, 1.0]])
    return 0.0 if in_view(position, Camera(torch.eye(4), K, 10, 10)).tolist() == [0, 4] else math.inf


@PART.case(why="decoders of the wrong width", done="refused in one sentence")
def outputs_that_do_not_fit() -> float:
    inputs = outputs(3, 2)
    inputs[5] = torch.zeros(3, 13)
    return refusal(ValueError, lambda: local_gaussians(*inputs), "do not fit")


@PART.case(
    why="a Gaussian's share of scale underflows", done="zero, which the rasteriser draws at a pixel's size", bound=1e-6
)
def scales_that_vanish() -> float:
    inputs = [x.detach() for x in outputs(3, 2)]
    inputs[5] = torch.full((3, 14), -200.0)
    found = local_gaussians(*inputs)
    return relative(found.scales, torch.zeros_like(found.scales))

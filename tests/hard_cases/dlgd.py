"""DLGD: residuals of offsets and scales that start at zero, stay positive and fade with the networks' saturation."""

from __future__ import annotations

import math

import torch

from aa4d.methods.adaanchor4d.geometry import OffsetDeformation, ScaleDeformation
from aa4d.stress.cases import Part
from tests.hard_cases.acfa import network_error

PART = Part("dlgd")


@PART.case(why="a residual that is not zero at the start moves the canonical scene", done="output layers start at zero")
def starts_at_the_canonical_geometry() -> float:
    embedding = torch.randn(4, 32)
    parts = [OffsetDeformation(32, 128, 10)(embedding, 0.5), ScaleDeformation(32, 128)(embedding, 0.5)]
    return max(float(part.detach().abs().max()) for part in parts)


@PART.case(
    why="a scale that is added to turns negative",
    done="a sum in log space: positive for every residual that float32 can raise e to",
    each={f"{residual:g}": residual for residual in (-80.0, -1.0, 0.0, 80.0)},
)
def scales_stay_positive(residual: float) -> float:
    scale = torch.full((3, 6), 0.05) * torch.tensor(residual).exp()
    return 0.0 if scale.isfinite().all() and (scale > 0).all() else math.inf


@PART.case(
    why="time as an input beside embeddings of 1e4 is lost in the sum",
    done="float32 keeps seven digits of it: the networks agree with float64",
    bound=1e-5,
    each={f"t = {t:g}": t for t in (0.0, 1e-30, 1e-7, 1.0)},
)
def time_beside_large_embeddings(t: float) -> float:
    torch.manual_seed(0)
    network = OffsetDeformation(32, 128, 10)
    torch.nn.init.normal_(network.output.weight)
    return network_error(torch.randn(50, 32) * 1e4, network.layers(), t, 1.0)


@PART.case(
    why="one anchor, and one more than a block of rows",
    done="padded rows have no gradient",
    bound=1e-5,
    each={str(n): n for n in (1, 127, 128, 129)},
)
def rows_around_a_block(rows: int) -> float:
    torch.manual_seed(rows)
    network = ScaleDeformation(32, 128)
    torch.nn.init.normal_(network.output.weight)
    return network_error(torch.randn(rows, 32), network.layers(), 0.5)

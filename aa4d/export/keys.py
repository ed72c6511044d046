"""A clip's Gaussians key by key: what the formats that interpolate between keys are written from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from aa4d.errors import InputError
from aa4d.export.clip import FAINTEST, Array, Clip

SMALLEST_SCALE_M = 1e-9  # a scale that underflowed is 0, whose logarithm is infinite


def times_of(clip: Clip, name: str) -> list[float]:
    """The t of every view, which are the keys.

    Raises:
        InputError: they do not rise; `name` is that of the format.
    """
    times = [view.t for view in clip.path.views]
    if any(after <= before for before, after in pairwise(times)):
        raise InputError(f"--format {name}: the times of the views must rise; leave out --path")
    return times


def decoded(clip: Clip) -> Iterator[dict[str, NDArray[np.float32]]]:
    """Every attribute [N, D] of all Gaussians, key by key; successive rotations lie in one hemisphere.

    "position" in metres, "rotation" w x y z, "log_scale" of metres, "opacity" (0 where it is too faint to be drawn),
    "color" in sRGB. Of a clip with harmonics also "harmonics" [N, (degree + 1)^2 * 3], the constant one first, channels
    innermost.
    """
    before: Array | None = None
    for index in range(len(clip)):
        g = clip.every_gaussian(index)
        rotation = g.quaternions
        if before is not None:
            rotation = np.where((rotation * before).sum(axis=1, keepdims=True) < 0, -rotation, rotation)
        before = rotation
        opacity = np.where(g.opacities >= FAINTEST, g.opacities, 0.0)
        values = {
            "position": g.means,
            "rotation": rotation,
            "log_scale": np.log(np.maximum(g.scales, SMALLEST_SCALE_M)),
            "opacity": opacity[:, None],
            "color": g.colors,
        }
        if g.harmonics is not None:
            coefficients = g.coefficients()
            values["harmonics"] = coefficients.reshape(len(rotation), 3 * coefficients.shape[1])
        yield {name: value.astype(np.float32) for name, value in values.items()}


def drawn_ids(clip: Clip, progress: Callable[[int], None]) -> NDArray[np.int64]:
    """The Gaussians that are drawn at any key, ascending; `progress` is told how many keys have been looked at.

    Raises:
        InputError: there are none.
    """
    drawn = np.zeros(0, bool)
    for index, values in enumerate(decoded(replace(clip, degree=0))):  # harmonics change no opacity
        seen = values["opacity"][:, 0] > 0
        drawn = drawn | seen if len(drawn) else seen
        progress(index + 1)
    if not drawn.any():
        raise InputError(f"{clip.loaded.path}: nothing is opaque enough to be drawn; train the model again")
    return np.flatnonzero(drawn)

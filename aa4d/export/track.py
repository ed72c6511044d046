"""The track file: Gaussians with ids at key times, quantized with a stated error (docs/formats.md).

Every view of the clip is a key. The model is decoded twice: once for the range that each Gaussian's attributes span,
which says what varies at all, and once for the keys, so that no more than the file's own size is held in memory.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save_file

from aa4d import __version__
from aa4d.errors import InputError
from aa4d.export.clip import Clip
from aa4d.export.keys import decoded, times_of
from aa4d.files import whole_file

NAME = "track.safetensors"
VERSION = 1
POSITION_TOLERANCE = 1e-5  # of the viewing distance: a hundredth of a pixel at 1000 pixels of focal length
KINDS: dict[str, tuple[type, float]] = {  # how keys are stored, and half the range below which nothing varies
    "position": (np.uint16, POSITION_TOLERANCE),
    "rotation": (np.uint16, 1e-3),
    "log_scale": (np.uint8, 5e-3),
    "opacity": (np.uint8, 2e-3),
    "color": (np.uint8, 2e-3),
}


@dataclass
class Range:
    """What an attribute of N Gaussians spans over the clip."""

    lower: NDArray[np.float32]  # [N, D]
    upper: NDArray[np.float32]  # [N, D]


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/track.safetensors.

    Raises:
        InputError: the views' times do not rise.
    """
    path, times = out / NAME, times_of(clip, "track")
    if path.exists():
        progress(2 * len(clip), 2 * len(clip))
        return
    drawn, ranges = _survey(clip, progress)
    if not len(drawn):
        raise InputError(f"{clip.loaded.path}: nothing is opaque enough to be drawn; train the model again")
    tensors: dict[str, NDArray[Any]] = {"ids": drawn.astype(np.uint32)}
    errors = {}
    for name, span in ranges.items():
        kind, tolerance = KINDS[name]
        tolerance *= clip.loaded.frame.unit_m if name == "position" else 1.0
        lower, upper = span.lower[drawn], span.upper[drawn]
        varies = ((upper - lower) > 2 * tolerance).any(axis=1)
        rest = (lower + upper) / 2
        box = np.stack([lower[varies], upper[varies]], axis=1)
        tensors[f"{name}.rest"], tensors[f"{name}.box"] = rest, box
        tensors[f"{name}.rows"] = np.flatnonzero(varies).astype(np.uint32)
        tensors[f"{name}.keys"] = np.zeros((len(clip), *box[:, 0].shape), kind)
        errors[name] = _largest_error(lower, upper, varies, np.iinfo(kind).max)
    for index, values in enumerate(decoded(clip)):
        for name, value in values.items():
            rows, box, keys = (tensors[f"{name}.{part}"] for part in ("rows", "box", "keys"))
            levels = np.iinfo(keys.dtype).max
            step = (box[:, 1] - box[:, 0]).astype(np.float64) / levels
            share = (value[drawn][rows] - box[:, 0]) / np.where(step > 0, step, 1)
            keys[index] = np.clip(np.round(share), 0, levels).astype(keys.dtype)
        progress(len(clip) + index + 1, 2 * len(clip))
    groups = clip.loaded.model.group
    if groups is not None:
        tensors["group"] = groups.numpy()[drawn // clip.loaded.model.per_unit].astype(np.int32)
    header = json.dumps(_header(clip, out, times, errors), allow_nan=False)
    with whole_file(path) as temporary:
        save_file(tensors, str(temporary), metadata={"aa4d": header})


def _largest_error(
    lower: NDArray[np.float32], upper: NDArray[np.float32], varies: NDArray[np.bool_], levels: int
) -> float:
    """At a key: half of what is not kept at all, half a level of what is, and the rounding of float32."""
    half = (upper - lower).astype(np.float64) / 2
    rounding = 4 * np.finfo(np.float32).eps * float(np.abs([lower, upper]).max())
    return float(np.where(varies[:, None], half / levels, half).max() + rounding)


def _survey(clip: Clip, progress: Callable[[int, int], None]) -> tuple[NDArray[np.int64], dict[str, Range]]:
    """The ids that are drawn at any key, and the range of every attribute of all Gaussians."""
    drawn, ranges = np.zeros(0, bool), dict[str, Range]()
    for index, values in enumerate(decoded(clip)):
        seen = values["opacity"][:, 0] > 0
        if not ranges:
            drawn, ranges = seen, {name: Range(value.copy(), value.copy()) for name, value in values.items()}
        drawn |= seen
        for name, value in values.items():
            np.minimum(ranges[name].lower, value, out=ranges[name].lower)
            np.maximum(ranges[name].upper, value, out=ranges[name].upper)
        progress(index + 1, 2 * len(clip))
    return np.flatnonzero(drawn), ranges


def _header(clip: Clip, out: Path, times: list[float], errors: dict[str, float]) -> dict[str, Any]:
    loaded = clip.loaded
    capture = loaded.capture_folder
    return {
        "format": "aa4d-track",
        "version": VERSION,
        "generator": f"aa4d {__version__}",
        "method": loaded.method,
        "t": times,
        "fps": loaded.fps,
        "camera": loaded.camera.as_json(),
        "frames": [frame.as_json() for frame in loaded.frames],
        "capture": None if capture is None else Path(os.path.relpath(capture, out.resolve())).as_posix(),
        "background": list(loaded.background),
        "seen_from": "each view" if clip.eye is None else clip.eye.tolist(),
        "groups": [{"name": name} for name in clip.group_names()],
        "errors": errors,
        **({} if clip.identity is None else {"identity": clip.identity.as_json()}),
        **({} if clip.origin is None else {"geographic_origin": dict(clip.origin)}),
    }

"""Track files for the tests, written by hand as docs/formats.md says: struct, json, numpy.

Of 30 Gaussians the first ten drive 12 m to the east over the clip while they make half a turn about z, the next five
appear from its second key to its third, and the last one turns from black to white.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from model_files import make_model, write_file

COUNT, FRAMES = 30, 5
WAY_M = 12.0
DTYPES = {"float32": "F32", "uint32": "U32", "int32": "I32", "uint16": "U16", "uint8": "U8"}
LEVELS = {"position": np.uint16, "rotation": np.uint16, "log_scale": np.uint8, "opacity": np.uint8, "color": np.uint8}
RIDE, APPEAR, FADE = np.arange(10), np.arange(10, 15), np.array([COUNT - 1])

Parts = tuple[dict[str, np.ndarray], dict[str, Any]]


def rest() -> dict[str, np.ndarray]:
    """The attributes at the first key."""
    random = np.random.default_rng(7)
    return {
        "position": random.uniform([18, -30, 0], [40, -10, 8], (COUNT, 3)),
        "rotation": np.tile([1.0, 0, 0, 0], (COUNT, 1)),
        "log_scale": np.log(random.uniform(0.1, 0.6, (COUNT, 3))),
        "opacity": np.where(np.arange(COUNT) // 5 == 2, 0.0, 0.9)[:, None],
        "color": np.where(np.arange(COUNT)[:, None] == FADE, 0.0, random.uniform(0.1, 0.9, (COUNT, 3))),
    }


def half_turn(t: float) -> np.ndarray:
    """The rotation of what rides, w x y z."""
    return np.array([np.cos(np.pi * t / 2), 0, 0, np.sin(np.pi * t / 2)])


def make_track(*, groups: bool = False) -> Parts:
    """The tensors and the metadata of a track with a key for each frame."""
    times = np.linspace(0, 1, FRAMES)
    east, none = WAY_M * times[:, None, None] * [1, 0, 0], np.zeros((FRAMES, 0, 3))
    varying = {  # rows, and values [T, M, D]
        "position": (RIDE, rest()["position"][RIDE] + east),
        "rotation": (RIDE, np.array([[half_turn(t)] * len(RIDE) for t in times])),
        "log_scale": (RIDE[:0], none),
        "opacity": (APPEAR, np.array([[[0.8 * (t > 0.3)]] * len(APPEAR) for t in times])),
        "color": (FADE, np.array([[[t] * 3] for t in times])),
    }
    tensors: dict[str, np.ndarray] = {"ids": 3 * np.arange(COUNT, dtype=np.uint32)}
    for name, (rows, values) in varying.items():
        lower, upper = values.min(axis=0), values.max(axis=0)
        levels = np.iinfo(LEVELS[name]).max
        share = (values - lower) / np.where(upper > lower, upper - lower, 1)
        tensors[f"{name}.rest"] = rest()[name].astype(np.float32)
        tensors[f"{name}.rows"] = rows.astype(np.uint32)
        tensors[f"{name}.box"] = np.stack([lower, upper], axis=1).astype(np.float32)
        tensors[f"{name}.keys"] = np.round(levels * share).astype(LEVELS[name])
    if groups:
        tensors["group"] = np.where(np.arange(COUNT) < 10, 0, -1).astype(np.int32)
    _, clip = make_model(1, FRAMES)
    information = {name: clip[name] for name in ("fps", "camera", "frames", "capture", "background")}
    information |= {
        "format": "aa4d-track",
        "version": 1,
        "generator": "tests",
        "method": "any",
        "t": times.tolist(),
        "seen_from": "each view",
        "groups": [{"name": "car 1"}] if groups else [],
        "errors": dict.fromkeys(LEVELS, 0.01),
    }
    return tensors, information


def make_still(
    attributes: dict[str, np.ndarray], camera: dict[str, Any], viewmats: list[np.ndarray], background: list[float]
) -> Parts:
    """A track of Gaussians that do not change, `attributes` [N, ...] as `rest` has them, seen by these cameras."""
    tensors, information = make_track()
    tensors["ids"] = np.arange(len(attributes["position"]), dtype=np.uint32)
    for name, values in attributes.items():
        tensors[f"{name}.rows"] = tensors[f"{name}.rows"][:0]
        tensors[f"{name}.box"] = tensors[f"{name}.box"][:0]
        tensors[f"{name}.keys"] = tensors[f"{name}.keys"][:, :0]
        tensors[f"{name}.rest"] = values.astype(np.float32)
    for frame, viewmat in zip(information["frames"], viewmats, strict=True):
        frame["viewmat"] = viewmat.tolist()
    return tensors, information | {"camera": camera, "background": background}


def write_track(path: Path, tensors: dict[str, np.ndarray], information: Any) -> Path:
    """A whole track file."""
    header: dict[str, Any] = {"__metadata__": {"aa4d": json.dumps(information)}}
    data = b""
    for name, tensor in tensors.items():
        start = len(data)
        data += np.ascontiguousarray(tensor).tobytes()
        header[name] = {"dtype": DTYPES[str(tensor.dtype)], "shape": tensor.shape, "data_offsets": [start, len(data)]}
    return write_file(path, header, data)

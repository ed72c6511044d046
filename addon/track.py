"""The track file: any method's model as Gaussians at key times (docs/formats.md, "The track file"). No bpy here."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .container import DTYPES, Entry, Floats, ModelFileError, read_header, read_tensors
from .header import FASTEST_FPS, Camera, Doubles, array, number, pinhole, poses_and_images, require

VERSION = 1
ATTRIBUTES = {"position": 3, "rotation": 4, "log_scale": 3, "opacity": 1, "color": 3}  # and their channels
LEVELS = {"U16": 65535, "U8": 255}


@dataclass(frozen=True)
class Channel:
    """One attribute of N Gaussians over T keys."""

    rest: Floats  # [N, D] of those that do not vary; of those that do, at the first key
    rows: npt.NDArray[np.int64]  # [M] the Gaussians that vary, ascending
    lower: Floats  # [M, D]
    step: Floats  # [M, D] a level of the keys
    keys: npt.NDArray[Any]  # [T, M, D] levels

    def at(self, key: int, fraction: float) -> Floats:
        """The values [N, D] at this fraction of the way from a key to the next."""
        values = self.rest.copy()
        if len(self.rows):
            levels = self.keys[key].astype(np.float32)
            if fraction:
                levels += np.float32(fraction) * (self.keys[key + 1].astype(np.float32) - levels)
            values[self.rows] = self.lower + levels * self.step
        return values


@dataclass(frozen=True)
class TrackGaussians:
    """N Gaussians at one time, in world metres."""

    positions: Floats  # [N, 3]
    colors: Floats  # [N, 3] sRGB
    opacities: Floats  # [N] in [0, 1]; 0: not there
    scales: Floats  # [N, 3] standard deviations
    quaternions: Floats  # [N, 4] w x y z, unit


@dataclass(frozen=True)
class Track:
    """A track file in memory, checked."""

    path: Path
    fps: float
    camera: Camera
    viewmats: Doubles  # [frames, 4, 4], world to camera
    images: tuple[str, ...]  # of the frames, relative to the capture
    capture: str | None  # the capture's folder, relative to the file
    background: tuple[float, float, float]  # sRGB
    times: Doubles  # [T] of the keys, rising within [0, 1]
    errors: Mapping[str, float]  # the largest, at the keys, by attribute
    ids: npt.NDArray[np.uint32]  # [N]
    channels: Mapping[str, Channel]

    def at(self, t: float) -> TrackGaussians:
        """All Gaussians at t: linear between two keys, and as at the first or last one outside of them."""
        place = float(np.interp(t, self.times, np.arange(len(self.times))))
        key = min(int(place), max(len(self.times) - 2, 0))
        values = {name: channel.at(key, place - key) for name, channel in self.channels.items()}
        length = np.linalg.norm(values["rotation"], axis=1, keepdims=True)
        return TrackGaussians(
            positions=values["position"],
            colors=np.clip(values["color"], 0, 1),
            opacities=np.clip(values["opacity"][:, 0], 0, 1),
            scales=np.exp(values["log_scale"]),
            quaternions=values["rotation"] / np.maximum(length, np.float32(1e-12)),
        )


def read_track(path: str | os.PathLike[str]) -> Track:
    """Read and check a track file.

    Raises:
        ModelFileError: the file is missing, cut short, malformed, newer than this reader, or holds unusable values.
    """
    path = Path(path)
    header = read_header(path, tuple(DTYPES))
    try:
        information = json.loads(header.metadata["aa4d"])
        if information["format"] != "aa4d-track":
            raise KeyError("format")
        version = information["version"]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ModelFileError(f"{path.name} is not a track file: its aa4d metadata is missing or damaged.") from error
    if type(version) is not int or not 1 <= version <= VERSION:
        raise ModelFileError(f"{path.name} is a track file of version {version!r}; this add-on reads {VERSION}.")
    try:
        fps = number(information["fps"], "fps")
        require(0 < fps <= FASTEST_FPS, f"fps must lie in (0, {FASTEST_FPS:g}]")
        camera = pinhole(information["camera"])
        viewmats, images = poses_and_images(information["frames"])
        background = array(information["background"], (3,), "background")
        require(((background >= 0) & (background <= 1)).all(), "background must lie in [0, 1]")
        capture = information["capture"]
        require(capture is None or isinstance(capture, str), "capture must be a path or null")
        require(isinstance(information["t"], list) and information["t"], "t must be a list of at least one time")
        times = array(information["t"], (len(information["t"]),), "t")
        require((np.diff(times) > 0).all() and times[0] >= 0 and times[-1] <= 1, "t must rise within [0, 1]")
        errors = {name: number(information["errors"][name], f"errors.{name}") for name in ATTRIBUTES}
    except KeyError as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata lacks {error}.") from error
    except (TypeError, AttributeError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not laid out as docs/formats.md says.") from error
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not usable: {error}.") from error
    _check_tensors(path.name, header.entries, len(times))
    wanted = ["ids", *(f"{name}.{part}" for name in ATTRIBUTES for part in ("rest", "rows", "box", "keys"))]
    tensors = read_tensors(path, header.entries, wanted)
    return Track(
        path=path,
        fps=fps,
        camera=camera,
        viewmats=viewmats,
        images=images,
        capture=capture,
        background=(float(background[0]), float(background[1]), float(background[2])),
        times=times,
        errors=errors,
        ids=tensors["ids"],
        channels={name: _channel(path.name, name, tensors, header.entries) for name in ATTRIBUTES},
    )


def _check_tensors(file_name: str, entries: Mapping[str, Entry], keys: int) -> None:
    count = _entry(file_name, entries, "ids", "U32").shape
    if len(count) != 1 or not count[0]:
        raise ModelFileError(f"{file_name} holds no Gaussians; export it again.")
    for name, channels in ATTRIBUTES.items():
        varying = next(iter(_entry(file_name, entries, f"{name}.rows", "U32").shape), 0)
        for part, dtypes, shape in (
            ("rest", ("F32",), (*count, channels)),
            ("rows", ("U32",), (varying,)),
            ("box", ("F32",), (varying, 2, channels)),
            ("keys", tuple(LEVELS), (keys, varying, channels)),
        ):
            found = _entry(file_name, entries, f"{name}.{part}", *dtypes).shape
            if found != shape:
                raise ModelFileError(f"{file_name}: tensor {name}.{part} has shape {list(found)}, not {list(shape)}.")


def _entry(file_name: str, entries: Mapping[str, Entry], name: str, *dtypes: str) -> Entry:
    if name not in entries or entries[name].dtype not in dtypes:
        raise ModelFileError(f"{file_name} lacks the tensor {name} of type {' or '.join(dtypes)}; export it again.")
    return entries[name]


def _channel(file_name: str, name: str, tensors: Mapping[str, Any], entries: Mapping[str, Entry]) -> Channel:
    rest, box = tensors[f"{name}.rest"], tensors[f"{name}.box"]
    rows = tensors[f"{name}.rows"].astype(np.int64)
    if (np.diff(rows, prepend=-1) <= 0).any() or (len(rows) and rows[-1] >= len(rest)):
        raise ModelFileError(f"{file_name}: {name}.rows must rise and name Gaussians that are there.")
    if (box[:, 1] < box[:, 0]).any():
        raise ModelFileError(f"{file_name}: {name}.box must not have upper values below lower ones.")
    step = (box[:, 1] - box[:, 0]) / np.float32(LEVELS[entries[f"{name}.keys"].dtype])
    return Channel(rest, rows, box[:, 0], step, tensors[f"{name}.keys"])

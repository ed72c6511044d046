"""The track file: any method's model as Gaussians at key times (docs/formats.md, "The track file"). No bpy here."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .clip import Clip, read_clip
from .container import DTYPES, Entry, Floats, ModelFileError, read_header, read_tensors
from .header import FARTHEST_MODEL_M, Doubles, array, number, require

FORMAT = "aa4d-track"
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

    @property
    def largest(self) -> Floats:
        """The largest magnitude [D] over all keys."""
        with np.errstate(over="ignore"):
            upper = self.lower + np.float32(np.iinfo(self.keys.dtype).max) * self.step
        values = np.concatenate([self.rest, self.lower, upper])
        return np.abs(values).max(axis=0)

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
class Track(Clip):
    """A track file in memory, checked."""

    times: Doubles  # [T] of the keys, rising within [0, 1]
    errors: Mapping[str, float]  # the largest, at the keys, by attribute
    ids: npt.NDArray[np.uint32]  # [N]
    group: npt.NDArray[np.intp] | None  # [N] the vehicle of each, -1 for the world; None where none are known
    channels: Mapping[str, Channel]

    def at(self, t: float) -> TrackGaussians:
        """All Gaussians at t: linear between two keys, and as at the first or last one outside of them."""
        color, log_scale, rotation = (self._value(name, t) for name in ("color", "log_scale", "rotation"))
        length = np.linalg.norm(rotation, axis=1, keepdims=True)
        return TrackGaussians(
            positions=self.positions_at(t),
            colors=np.clip(color, 0, 1),
            opacities=self.opacities_at(t),
            scales=np.exp(log_scale),
            quaternions=rotation / np.maximum(length, np.float32(1e-12)),
        )

    def positions_at(self, t: float) -> Floats:
        """The places [N, 3] of `at` alone."""
        return self._value("position", t)

    def opacities_at(self, t: float) -> Floats:
        """The opacities [N] of `at` alone."""
        return np.clip(self._value("opacity", t)[:, 0], 0, 1)

    def _value(self, name: str, t: float) -> Floats:
        place = float(np.interp(t, self.times, np.arange(len(self.times))))
        key = min(int(place), max(len(self.times) - 2, 0))  # the one before t
        return self.channels[name].at(key, place - key)


def read_track(path: str | os.PathLike[str]) -> Track:
    """Read and check a track file.

    Raises:
        ModelFileError: the file is missing, cut short, malformed, newer than this reader, or holds unusable values.
    """
    path = Path(path)
    header = read_header(path, tuple(DTYPES))
    try:
        information = json.loads(header.metadata["aa4d"])
        if information["format"] != FORMAT:
            raise KeyError("format")
        version = information["version"]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ModelFileError(f"{path.name} is not a track file: its aa4d metadata is missing or damaged.") from error
    if type(version) is not int or not 1 <= version <= VERSION:
        raise ModelFileError(f"{path.name} is a track file of version {version!r}; this add-on reads {VERSION}.")
    try:
        clip = read_clip(path, information)
        require(isinstance(information["t"], list) and information["t"], "t must be a list of at least one time")
        times = array(information["t"], (len(information["t"]),), "t")
        require((np.diff(times) > 0).all() and times[0] >= 0 and times[-1] <= 1, "t must rise within [0, 1]")
        require(isinstance(information["groups"], list), "groups must be a list")
        group_count = len(information["groups"])
        errors = {name: number(information["errors"][name], f"errors.{name}") for name in ATTRIBUTES}
    except KeyError as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata lacks {error}.") from error
    except (TypeError, AttributeError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not laid out as docs/formats.md says.") from error
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not usable: {error}.") from error
    _check_tensors(path.name, header.entries, len(times), group_count)
    wanted = [f"{name}.{part}" for name in ATTRIBUTES for part in ("rest", "rows", "box", "keys")]
    wanted += ["ids", "group"] if group_count else ["ids"]
    tensors = read_tensors(path, header.entries, wanted)
    channels = {name: _channel(path.name, name, tensors, header.entries) for name in ATTRIBUTES}
    farthest = float(channels["position"].largest.max())
    if not farthest <= FARTHEST_MODEL_M:
        raise ModelFileError(
            f"{path.name} places a Gaussian {farthest:.3g} m from the origin; a world is local, within "
            f"{FARTHEST_MODEL_M:g} m."
        )
    group = tensors["group"].astype(np.intp) if group_count else None
    if group is not None and not ((group >= -1) & (group < group_count)).all():
        raise ModelFileError(f"{path.name}: group names a group that is not there; the file has {group_count}.")
    return Track(
        **vars(clip),
        times=times,
        errors=errors,
        ids=tensors["ids"],
        group=group,
        channels=channels,
    )


def _check_tensors(file_name: str, entries: Mapping[str, Entry], keys: int, groups: int) -> None:
    count = _entry(file_name, entries, "ids", "U32").shape
    if len(count) != 1 or not count[0]:
        raise ModelFileError(f"{file_name} holds no Gaussians; export it again.")
    if groups and _entry(file_name, entries, "group", "I32").shape != count:
        raise ModelFileError(f"{file_name}: tensor group must have a number for each of the {count[0]} Gaussians.")
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
    with np.errstate(over="ignore"):  # numbers that overflow are found where they are shown
        step = (box[:, 1] - box[:, 0]) / np.float32(LEVELS[entries[f"{name}.keys"].dtype])
    return Channel(rest, rows, box[:, 0], step, tensors[f"{name}.keys"])

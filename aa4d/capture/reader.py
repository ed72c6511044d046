"""Reading a capture folder (docs/formats.md), checked before anything is trained on it."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData

from aa4d.capture.content import capture_identity
from aa4d.capture.pictures import has_eight_bits, pixel_format
from aa4d.capture.schema import (
    FARTHEST_M,
    RECENTER,
    Frame,
    PinholeCamera,
    check_frames,
    frame_of_index,
    frame_rate,
    list_of,
    path_inside,
    pinhole_camera,
)
from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.identity import Identity

CAPTURE_VERSION = 1


@dataclass(frozen=True)
class Capture:
    folder: Path
    name: str
    identity: Identity  # covers everything that the folder holds
    fps: float
    camera: PinholeCamera
    frames: tuple[Frame, ...]
    points: NDArray[np.float64]  # [P, 3] world metres
    point_colors: NDArray[np.uint8]  # [P, 3] sRGB
    tracks: str | None
    instance_names: dict[int, str] = field(default_factory=dict)  # by id; empty where the capture names none
    heterogeneity: dict[str, float] = field(default_factory=dict)  # of a rendered scene (docs/truth.md), by name
    fingerprint: str | None = None  # digest of capture.json alone, by which runs of older versions know their capture

    def of_split(self, split: str) -> list[int]:
        return [i for i, frame in enumerate(self.frames) if frame.split == split]


def read_capture(folder: Path, *, to_train: bool = True) -> Capture:
    """Read and check everything but the pixels.

    Args:
        to_train: whether it must have training frames.

    Raises:
        InputError: names the file and the key that is missing, malformed or not finite.
    """
    index = folder / "capture.json"
    if folder.is_file():
        raise InputError(f"{folder}: is a file; name the folder of the capture that holds it")
    if not folder.is_dir():
        raise InputError(f"{folder}: no such capture folder; make one with `aa4d synth` or `aa4d capture`")
    if not index.exists():
        raise InputError(
            f"{folder}: has no capture.json, so no capture, or an unfinished one: run the command that makes it again"
        )
    document = read_json_object(index, "the index of a capture")
    if document.get("format") != "aa4d-capture":
        raise InputError(f'{index}: key "format" is {document.get("format")!r}, expected "aa4d-capture"')
    version = document.get("version")
    if not isinstance(version, int) or version < 1 or version > CAPTURE_VERSION:
        raise InputError(f"{index}: version {version!r} is not known here (newest: {CAPTURE_VERSION}); update aa4d")
    camera = pinhole_camera(document, index)
    frames = tuple(frame_of_index(value, i, index) for i, value in enumerate(list_of(document, "frames", index)))
    check_frames(frames, index, to_train=to_train)
    tracks = document.get("tracks")
    points, colors = _points(folder / path_inside(document.get("points"), "points", index))
    return Capture(
        folder=folder,
        name=str(document.get("name", folder.name)),
        identity=capture_identity(folder, document),
        fps=frame_rate(document, index),
        camera=camera,
        frames=frames,
        points=points,
        point_colors=colors,
        tracks=None if tracks is None else path_inside(tracks, "tracks", index),
        instance_names=_instance_names(document.get("instances")),
        heterogeneity=_heterogeneity(document.get("heterogeneity")),
        fingerprint=hashlib.sha256(index.read_bytes()).hexdigest()[:16],
    )


def _instance_names(value: Any) -> dict[int, str]:
    """Names are for people: what is malformed is left out."""
    named = value if isinstance(value, list) else []
    return {
        i["id"]: str(i["name"]) for i in named if isinstance(i, dict) and isinstance(i.get("id"), int) and "name" in i
    }


def _heterogeneity(value: Any) -> dict[str, float]:
    """Numbers for tables: what is malformed is left out."""
    named = value if isinstance(value, dict) else {}
    return {str(k): float(v) for k, v in named.items() if isinstance(v, int | float) and math.isfinite(v)}


def read_image(capture: Capture, frame: Frame) -> NDArray[np.uint8]:
    """[H, W, 3] sRGB. Raises InputError for a missing, truncated or wrongly sized image."""
    path = capture.folder / frame.image
    try:
        with Image.open(path) as image:
            if not has_eight_bits(image):  # Pillow would cut off 16 bits of grey at 255, everything white
                raise ValueError(f"its pixels are {pixel_format(image)}, expected 8 bits a channel")
            if "A" in image.getbands() and image.getchannel("A").getextrema() != (255, 255):
                raise ValueError("it is transparent in places, expected three channels")
            pixels = np.array(image.convert("RGB"))
    except FileNotFoundError:
        raise InputError(f"{path}: image of frame {frame.name!r} is missing; render or copy it again") from None
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: image of frame {frame.name!r} cannot be read ({error}); make it again") from None
    expected = (capture.camera.height, capture.camera.width)
    if pixels.shape[:2] != expected:
        raise InputError(
            f"{path}: image is {pixels.shape[1]}x{pixels.shape[0]}, but the capture's camera says "
            f"{expected[1]}x{expected[0]}; all frames must have that size"
        )
    return pixels


def read_images(capture: Capture, frames: list[int]) -> NDArray[np.uint8]:
    """[len(frames), H, W, 3] sRGB."""
    return np.stack([read_image(capture, capture.frames[i]) for i in frames])


def _points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    try:
        vertex = PlyData.read(str(path))["vertex"]
        points = np.stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"], axis=1)
        channels = [np.asarray(vertex[c]) for c in ("red", "green", "blue")]
    except FileNotFoundError:
        raise InputError(f"{path}: the initial point cloud is missing") from None
    except Exception as error:  # plyfile raises parse errors, KeyError and ValueError alike
        raise InputError(f"{path}: not a point cloud with x y z red green blue ({error})") from None
    if others := [channel.dtype.name for channel in channels if channel.dtype != np.uint8]:
        raise InputError(f"{path}: colors are {others[0]}, expected bytes (uchar), 0 to 255; export it with those")
    colors = np.stack(channels, axis=1)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: point {bad[0]} is not finite; remove it from the point cloud")
    far = np.flatnonzero((np.abs(points) > FARTHEST_M).any(axis=1))
    if len(far):
        raise InputError(f"{path}: point {far[0]} is over {FARTHEST_M:g} m from the origin; {RECENTER}")
    if len(points) < 4:
        raise InputError(f"{path}: holds {len(points)} points, at least 4 are needed to start from")
    return points, colors

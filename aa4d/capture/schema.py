"""Cameras, frames and numbers in capture.json, model headers and camera paths, checked one by one.

Every refusal is an InputError that names the file (`index`) and the key.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aa4d.errors import InputError

FARTHEST_M = 10_000.0  # beyond, float32 in renderers and viewers loses what a pixel shows
RECENTER = "move the scene to a local origin"
MAX_SIDE_PX = 16_384  # a slip of the keyboard should not fill the memory
MAX_FOCAL_PX = 1e6
MAX_FPS = 1000.0
LATEST_S = 1e11  # seconds since 1970 are a clip's time too
MAX_NAME_BYTES = 200  # with its ending and a prefix it must fit what file systems take


@dataclass(frozen=True)
class PinholeCamera:
    width: int
    height: int
    K: NDArray[np.float64]  # [3, 3] pixels

    def as_json(self) -> dict[str, Any]:
        return {"model": "PINHOLE", "width": self.width, "height": self.height, "K": self.K.tolist()}


@dataclass(frozen=True)
class Frame:
    name: str
    image: str  # path inside the capture
    truth: str | None
    time_s: float
    t: float
    split: str  # "train" or "test"
    viewmat: NDArray[np.float64]  # [4, 4] world (metres) to camera
    exposure: NDArray[np.float64] | None = None  # [3, 4] what the camera makes of a color, where training learned it

    def as_json(self) -> dict[str, Any]:
        """As the model file keeps it: without the path of the truth."""
        return {
            "name": self.name,
            "image": self.image,
            "time_s": self.time_s,
            "t": self.t,
            "split": self.split,
            "viewmat": self.viewmat.tolist(),
            **({} if self.exposure is None else {"exposure": self.exposure.tolist()}),
        }


def frame_rate(document: dict[str, Any], index: Path) -> float:
    """The value of key "fps"; `index` is the file to name where it is refused."""
    fps = number_of(document, "fps", index)
    if not 0 < fps <= MAX_FPS:
        raise InputError(f'{index}: key "fps" must lie in (0, {MAX_FPS:g}], found {fps:g}')
    return fps


def pinhole_camera(document: dict[str, Any], index: Path) -> PinholeCamera:
    """The value of key "camera"; `index` is the file to name where it is refused."""
    value = document.get("camera")
    if not isinstance(value, dict):
        raise InputError(f'{index}: key "camera" is missing or not an object')
    if value.get("model") != "PINHOLE":
        raise InputError(
            f'{index}: camera model {value.get("model")!r} is not supported, expected "PINHOLE"; render the scene '
            "without [effects.lens_distortion], or undistort the frames first"
        )
    if others := sorted(str(key) for key in value if key not in ("model", "width", "height", "K")):
        raise InputError(
            f"{index}: camera has the key {others[0]!r:.40}, which a PINHOLE does not know; undistort the frames, or "
            "remove it"
        )
    width, height = value.get("width"), value.get("height")
    if not (type(width) is int and type(height) is int and width > 0 and height > 0):
        raise InputError(f"{index}: camera width and height must be positive integers, found {width!r} x {height!r}")
    if max(width, height) > MAX_SIDE_PX:
        raise InputError(f"{index}: camera is {width}x{height}, over {MAX_SIDE_PX} pixels along a side")
    K = matrix_of(value.get("K"), (3, 3), "camera K", index)
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"{index}: camera K has a focal length that is not positive")
    if np.abs(K).max() > MAX_FOCAL_PX:
        raise InputError(f"{index}: camera K holds {K.flat[np.abs(K).argmax()]:g}, over {MAX_FOCAL_PX:g} pixels")
    if K[0, 1] != 0 or K[1, 0] != 0 or not np.array_equal(K[2], [0, 0, 1]):
        raise InputError(f"{index}: camera K must have zero skew and last row 0 0 1")
    return PinholeCamera(width, height, K)


def frame_of_index(value: Any, number: int, index: Path) -> Frame:
    """One frame of a capture's index or of a model's header; `index` is the file to name where it is refused."""
    if not isinstance(value, dict):
        raise InputError(f"{index}: frame {number} is not an object")
    name = str(value.get("name", number))
    label = f"frame {name!r}"
    check_name(name, label, index)
    if value.get("viewmat") is None:
        raise InputError(f"{index}: {label} has no pose (viewmat); remove the frame or add its pose")
    viewmat = pose_of(value["viewmat"], label, index)
    split = value.get("split")
    if split not in ("train", "test"):
        raise InputError(f'{index}: split of {label} is {split!r}, expected "train" or "test"')
    truth = value.get("truth")
    return Frame(
        name=name,
        image=path_inside(value.get("image"), f"image of {label}", index),
        truth=None if truth is None else path_inside(truth, f"truth of {label}", index),
        time_s=number_of(value, "time_s", index, label),
        t=number_of(value, "t", index, label),
        split=split,
        viewmat=viewmat,
        exposure=matrix_of(value["exposure"], (3, 4), f"exposure of {label}", index) if "exposure" in value else None,
    )


def check_name(name: str, label: str, index: Path) -> None:
    """Pictures of a frame are written under its name, so it must not lead anywhere else."""
    is_text = name == name.encode(errors="replace").decode()
    if not name or not is_text or name.startswith(".") or any(c in name for c in "/\\:\0"):
        raise InputError(f"{index}: {label} has a name that is no plain file name; rename it")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise InputError(f"{index}: {label[:40]}...' has a name longer than {MAX_NAME_BYTES} bytes; rename it")


def pose_of(value: Any, label: str, index: Path) -> NDArray[np.float64]:
    """A world-to-camera matrix [4, 4]: a rotation and a translation, near enough to the origin."""
    viewmat = matrix_of(value, (4, 4), f"viewmat of {label}", index)
    rotation = viewmat[:3, :3]
    if not is_rigid(viewmat, 1e-4):
        raise InputError(f"{index}: viewmat of {label} is not a rotation and a translation")
    if np.abs(rotation.T @ viewmat[:3, 3]).max() > FARTHEST_M:
        raise InputError(f"{index}: camera of {label} is over {FARTHEST_M:g} m from the origin; {RECENTER}")
    return viewmat


def is_rigid(matrix: NDArray[np.float64], tolerance: float) -> bool:
    """True where a matrix [4, 4] is a rotation and a translation; NaN is none."""
    rotation = matrix[:3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    is_rotation = off < tolerance and np.linalg.det(rotation) > 0
    return bool(is_rotation and np.isfinite(matrix).all() and np.abs(matrix[3] - [0, 0, 0, 1]).max() <= 1e-9)


def check_frames(frames: tuple[Frame, ...], index: Path, *, to_train: bool = True) -> None:
    """Names that differ, seconds and t in [0, 1] that rise, something to train on unless only scores are wanted;
    `index` is the file to name."""
    if to_train and not any(frame.split == "train" for frame in frames):
        raise InputError(f"{index}: has no training frame; at least one is needed")
    names = [frame.name for frame in frames]
    repeated = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    if repeated:
        raise InputError(f"{index}: duplicate frame name {sorted(repeated)[0]!r}")
    for before, after in pairwise(frames):
        for key in ("t", "time_s"):
            if not getattr(before, key) < getattr(after, key):
                raise InputError(f"{index}: {key} of frame {after.name!r} does not follow that of {before.name!r}")
    for frame in frames:
        if not 0.0 <= frame.t <= 1.0:
            raise InputError(f"{index}: t of frame {frame.name!r} is {frame.t}, outside [0, 1]")
        if abs(frame.time_s) > LATEST_S:
            raise InputError(f"{index}: time_s of frame {frame.name!r} is {frame.time_s:g}, over {LATEST_S:g} seconds")


def path_inside(value: Any, what: str, index: Path) -> str:
    """A relative path that stays in the capture folder."""
    if not isinstance(value, str) or not value:
        raise InputError(f"{index}: {what} is missing or not a path")
    path = PurePosixPath(value)
    if path.is_absolute() or ".." in path.parts or "\\" in value or ":" in value:
        raise InputError(f"{index}: {what} is {value!r}, which leaves the capture folder")
    return value


def list_of(document: dict[str, Any], key: str, index: Path) -> list[Any]:
    value = document.get(key)
    if not isinstance(value, list) or not value:
        raise InputError(f'{index}: key "{key}" is missing or empty')
    return value


def number_of(document: dict[str, Any], key: str, index: Path, label: str = "") -> float:
    """A finite number; `index` is the file to name where it is refused."""
    if not isinstance(document, dict):
        raise InputError(f'{index}: {label or "the document"} is no object, but should hold the key "{key}"')
    value = document.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        where = f" of {label}" if label else ""
        raise InputError(f'{index}: key "{key}"{where} must be a finite number, found {value!r:.40}')
    return float(value)


def matrix_of(value: Any, shape: tuple[int, ...], what: str, index: Path) -> NDArray[np.float64]:
    """Finite numbers in that shape; `index` is the file to name where they are refused."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        size = "x".join(str(side) for side in shape)
        raise InputError(f"{index}: {what} is not a {size} matrix of numbers") from None
    if matrix.shape != shape:
        raise InputError(f"{index}: {what} has shape {matrix.shape}, expected {shape}")
    if not np.isfinite(matrix).all():
        raise InputError(f"{index}: {what} holds NaN or infinity")
    return matrix

"""Reading a capture folder (docs/formats.md), checked before anything is trained on it."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData

from aa4d.capture.content import capture_identity
from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.identity import Identity

CAPTURE_VERSION = 1
FARTHEST_M = 10_000.0  # beyond, float32 in renderers and viewers loses what a pixel shows
RECENTRE = "move the scene to a local origin"
MOST_PX = 16_384  # along a side: a slip of the keyboard should not fill the memory
LARGEST_K = 1e6  # pixels
LONGEST_NAME = 200  # bytes: with its ending and a prefix it must fit what file systems take


EIGHT_BITS = ("RGB", "RGBA", "L", "LA", "P", "1", "CMYK", "YCbCr")  # Pillow's names


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

    def as_json(self) -> dict[str, Any]:
        """As the model file keeps it: without the path of the truth."""
        return {
            "name": self.name,
            "image": self.image,
            "time_s": self.time_s,
            "t": self.t,
            "split": self.split,
            "viewmat": self.viewmat.tolist(),
        }


@dataclass(frozen=True)
class Capture:
    folder: Path
    name: str
    identity: Identity  # of everything that the folder holds
    fps: float
    camera: PinholeCamera
    frames: tuple[Frame, ...]
    points: NDArray[np.float64]  # [P, 3] world metres
    point_colors: NDArray[np.uint8]  # [P, 3] sRGB
    tracks: str | None
    instance_names: dict[int, str] = field(default_factory=dict)  # by id; empty where the capture names none
    fingerprint: str | None = None  # of capture.json alone, by which runs of older versions know their capture

    def of_split(self, split: str) -> list[int]:
        return [i for i, frame in enumerate(self.frames) if frame.split == split]


@dataclass(frozen=True)
class Boxes:
    """Annotated boxes of a capture of footage, B of them, ordered by frame."""

    frame: NDArray[np.int64]  # [B] rank of the frame
    target: NDArray[np.int64]  # [B] the same number for the same object in every frame; -1: not followed
    box_px: NDArray[np.float64]  # [B, 4] left, top, right, bottom, cut at the frame's edges
    category: NDArray[np.str_]  # [B] "" where it is not known


BOXES = "movers/boxes.npz"


def read_capture(folder: Path) -> Capture:
    """Read and check everything but the pixels.

    Raises:
        InputError: names the file and the key that is missing, malformed or not finite.
    """
    index = folder / "capture.json"
    if folder.is_file():
        raise InputError(f"{folder}: is a file; name the folder of the capture that holds it")
    if not folder.is_dir():
        raise InputError(f"{folder}: no such capture folder; make one with `aa4d synth` or `aa4d capture`")
    if not index.exists():
        raise InputError(f"{folder}: has no capture.json; if it is an unfinished capture, run the same command again")
    document = read_json_object(index, "the index of a capture")
    if document.get("format") != "aa4d-capture":
        raise InputError(f'{index}: key "format" is {document.get("format")!r}, expected "aa4d-capture"')
    version = document.get("version")
    if not isinstance(version, int) or version < 1 or version > CAPTURE_VERSION:
        raise InputError(f"{index}: version {version!r} is not known here (newest: {CAPTURE_VERSION}); update aa4d")
    camera = pinhole_camera(document, index)
    frames = tuple(frame_of_index(value, i, index) for i, value in enumerate(_list(document, "frames", index)))
    check_frames(frames, index)
    fps = number_of(document, "fps", index)
    if fps <= 0:
        raise InputError(f'{index}: key "fps" must be positive, found {fps}')
    tracks = document.get("tracks")
    points, colors = _points(folder / _inside(document.get("points"), "points", index))
    return Capture(
        folder=folder,
        name=str(document.get("name", folder.name)),
        identity=capture_identity(folder, document),
        fps=fps,
        camera=camera,
        frames=frames,
        points=points,
        point_colors=colors,
        tracks=None if tracks is None else _inside(tracks, "tracks", index),
        instance_names=_instance_names(document.get("instances")),
        fingerprint=hashlib.sha256(index.read_bytes()).hexdigest()[:16],
    )


def _instance_names(value: Any) -> dict[int, str]:
    """Names are for people: what is malformed is left out."""
    named = value if isinstance(value, list) else []
    return {
        i["id"]: str(i["name"]) for i in named if isinstance(i, dict) and isinstance(i.get("id"), int) and "name" in i
    }


def read_image(capture: Capture, frame: Frame) -> NDArray[np.uint8]:
    """[H, W, 3] sRGB. Raises InputError for a missing, truncated or wrongly sized image."""
    path = capture.folder / frame.image
    try:
        with Image.open(path) as image:
            if image.mode not in EIGHT_BITS:  # Pillow would cut 16 bits off at 255: everything white
                raise ValueError(f"it is of mode {image.mode}, expected 8 bits a channel")
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


def moving_mask(capture: Capture, index: int) -> NDArray[np.bool_] | None:
    """Pixels of what moves at that frame, [H, W]; None where nothing says so.

    The truth knows the instances that move; a capture of footage has masks of movers, boxes or estimates.
    """
    truth = capture.frames[index].truth
    if truth is None or capture.tracks is None:
        return _movers(capture, index)
    instance_id = instance_ids_of(capture, index)
    tracks = capture.folder / capture.tracks
    ids, moving = read_array(tracks, "instance_id"), read_array(tracks, "moving")
    if moving.shape != (len(capture.frames), len(ids)):
        raise InputError(f"{tracks}: moving has shape {moving.shape}, expected {(len(capture.frames), len(ids))}")
    assert instance_id is not None
    return np.isin(instance_id, ids[moving[index]])


@dataclass(frozen=True)
class ObjectTracks:
    """The M instances of a capture with truth, at its N frames."""

    names: tuple[str, ...]  # [M]
    instance_id: NDArray[np.uint32]  # [M]
    object_to_world: NDArray[np.float64]  # [N, M, 4, 4]; the origin is the center of the footprint, x forward
    moving: NDArray[np.bool_]  # [N, M]
    present: NDArray[np.bool_]  # [N, M]


def object_tracks(capture: Capture) -> ObjectTracks | None:
    """Poses of the instances over time; None where the capture has no truth. Raises InputError for damaged ones."""
    if capture.tracks is None:
        return None
    path = capture.folder / capture.tracks
    ids, poses, moving = (read_array(path, name) for name in ("instance_id", "object_to_world", "moving"))
    shape = (len(capture.frames), len(ids))
    present = read_array(path, "present") if "present" in _names(path) else np.ones(shape, bool)
    for name, value, expected in (
        ("object_to_world", poses, (*shape, 4, 4)),
        ("moving", moving, shape),
        ("present", present, shape),
    ):
        if value.shape != expected:
            raise InputError(f"{path}: {name} has shape {value.shape}, expected {expected}; make the capture again")
    if not all(is_rigid(pose, 1e-4) for pose in poses.reshape(-1, 4, 4)):
        raise InputError(f"{path}: object_to_world holds what is no rigid motion; make the capture again")
    if len(np.unique(ids)) < len(ids):
        raise InputError(f"{path}: an instance_id stands twice; make the capture again")
    names = tuple(capture.instance_names.get(int(i), f"instance {i}") for i in ids)
    return ObjectTracks(names, ids, poses, moving, present)


def _movers(capture: Capture, index: int) -> NDArray[np.bool_] | None:
    path = capture.folder / "movers" / f"{capture.frames[index].name}.png"
    if not path.is_file():
        return None
    try:
        with Image.open(path) as image:
            mask = np.array(image.convert("L")) > 127
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: mask of movers cannot be read ({error}); make the capture again") from None
    expected = (capture.camera.height, capture.camera.width)
    if mask.shape != expected:
        raise InputError(f"{path}: mask of movers has shape {mask.shape}, expected {expected}; make the capture again")
    return mask


def boxes_of(capture: Capture) -> Boxes | None:
    """The annotated boxes of a capture of footage; None where it has none.

    Raises:
        InputError: names the array that is missing, malformed or of frames and pixels that the capture does not have.
    """
    path = capture.folder / BOXES
    if not path.is_file():
        return None
    frame, target, box, category = (read_array(path, name) for name in ("frame", "target", "box_px", "category"))
    count = len(frame) if frame.ndim else 0
    for name, array, shape, kinds in (
        ("frame", frame, (count,), "iu"),
        ("target", target, (count,), "iu"),
        ("box_px", box, (count, 4), "f"),
        ("category", category, (count,), "U"),
    ):
        if array.shape != shape or array.dtype.kind not in kinds:
            raise InputError(
                f"{path}: array {name!r} is {array.dtype} of shape {array.shape}, expected shape {shape}; "
                "make the capture again"
            )
    unknown = np.flatnonzero((frame < 0) | (frame >= len(capture.frames)))
    if len(unknown):
        raise InputError(
            f"{path}: box {unknown[0]} is of frame {frame[unknown[0]]}, and there are {len(capture.frames)}; "
            "make the capture again"
        )
    limits = np.array([capture.camera.width, capture.camera.height] * 2)
    with np.errstate(invalid="ignore"):  # NaN fails every comparison
        good = (box[:, :2] < box[:, 2:]).all(axis=1) & ((box >= 0) & (box <= limits)).all(axis=1)
    if not good.all():
        raise InputError(f"{path}: box {np.flatnonzero(~good)[0]} is no rectangle in the frame; make the capture again")
    return Boxes(frame.astype(np.int64), target.astype(np.int64), box.astype(np.float64), category)


def depth_of(capture: Capture, index: int) -> NDArray[np.float32] | None:
    """depth_z of a frame, [H, W] metres; None where the capture has no truth."""
    return _truth(capture, index, "depth_z")


def instance_ids_of(capture: Capture, index: int) -> NDArray[np.uint32] | None:
    """instance_id of a frame, [H, W], 0 for the world; None where the capture has no truth."""
    return _truth(capture, index, "instance_id")


def _truth(capture: Capture, index: int, name: str) -> NDArray[Any] | None:
    truth = capture.frames[index].truth
    if truth is None:
        return None
    value = read_array(capture.folder / truth, name)
    expected = (capture.camera.height, capture.camera.width)
    if value.shape != expected:
        raise InputError(f"{capture.folder / truth}: {name} has shape {value.shape}, expected {expected}")
    return value


def read_array(path: Path, name: str) -> NDArray[Any]:
    """An array of a file of truth. Raises InputError where it is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return np.asarray(file[name])
    except FileNotFoundError:
        raise InputError(f"{path}: truth is missing; make the capture again") from None
    except Exception as error:  # zipfile, zlib and numpy each raise their own kind for a damaged file
        raise InputError(f"{path}: array {name!r} cannot be read ({error}); make the capture again") from None


def _names(path: Path) -> list[str]:
    with np.load(path, allow_pickle=False) as file:
        return list(file.files)


def _points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    try:
        vertex = PlyData.read(str(path))["vertex"]
        points = np.stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"], axis=1)
        colors = np.stack([np.asarray(vertex[c], np.uint8) for c in ("red", "green", "blue")], axis=1)
    except FileNotFoundError:
        raise InputError(f"{path}: the initial point cloud is missing") from None
    except Exception as error:  # plyfile raises parse errors, KeyError and ValueError alike
        raise InputError(f"{path}: not a point cloud with x y z red green blue ({error})") from None
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: point {bad[0]} is not finite; remove it from the point cloud")
    far = np.flatnonzero((np.abs(points) > FARTHEST_M).any(axis=1))
    if len(far):
        raise InputError(f"{path}: point {far[0]} is over {FARTHEST_M:g} m from the origin; {RECENTRE}")
    if len(points) < 4:
        raise InputError(f"{path}: holds {len(points)} points, at least 4 are needed to start from")
    return points, colors


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
    width, height = value.get("width"), value.get("height")
    if not (isinstance(width, int) and isinstance(height, int) and width > 0 and height > 0):
        raise InputError(f"{index}: camera width and height must be positive integers, found {width!r} x {height!r}")
    if max(width, height) > MOST_PX:
        raise InputError(f"{index}: camera is {width}x{height}, over {MOST_PX} pixels along a side")
    K = matrix_of(value.get("K"), (3, 3), "camera K", index)
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"{index}: camera K has a focal length that is not positive")
    if np.abs(K).max() > LARGEST_K:
        raise InputError(f"{index}: camera K holds {K.flat[np.abs(K).argmax()]:g}, over {LARGEST_K:g} pixels")
    if K[0, 1] != 0 or K[1, 0] != 0 or not np.array_equal(K[2], [0, 0, 1]):
        raise InputError(f"{index}: camera K has a skew or another last row than 0 0 1, which no pinhole here has")
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
        image=_inside(value.get("image"), f"image of {label}", index),
        truth=None if truth is None else _inside(truth, f"truth of {label}", index),
        time_s=number_of(value, "time_s", index, label),
        t=number_of(value, "t", index, label),
        split=split,
        viewmat=viewmat,
    )


def check_name(name: str, label: str, index: Path) -> None:
    """Pictures of a frame are written under its name, so it must not lead anywhere else."""
    if not name or name.startswith(".") or any(c in name for c in "/\\:\0"):
        raise InputError(f"{index}: {label} has a name that is no plain file name; rename it")
    if len(name.encode()) > LONGEST_NAME:
        raise InputError(f"{index}: {label[:40]}...' has a name longer than {LONGEST_NAME} bytes; rename it")


def pose_of(value: Any, label: str, index: Path) -> NDArray[np.float64]:
    """A world-to-camera matrix [4, 4]: a rotation and a translation, near enough to the origin."""
    viewmat = matrix_of(value, (4, 4), f"viewmat of {label}", index)
    rotation = viewmat[:3, :3]
    if not is_rigid(viewmat, 1e-4):
        raise InputError(f"{index}: viewmat of {label} is not a rotation and a translation")
    if np.abs(rotation.T @ viewmat[:3, 3]).max() > FARTHEST_M:
        raise InputError(f"{index}: camera of {label} is over {FARTHEST_M:g} m from the origin; {RECENTRE}")
    return viewmat


def is_rigid(matrix: NDArray[np.float64], tolerance: float) -> bool:
    """Whether a matrix [4, 4] is a rotation and a translation; NaN is none."""
    rotation = matrix[:3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    is_rotation = off < tolerance and np.linalg.det(rotation) > 0
    return bool(is_rotation and np.isfinite(matrix).all() and np.abs(matrix[3] - [0, 0, 0, 1]).max() <= 1e-9)


def check_frames(frames: tuple[Frame, ...], index: Path) -> None:
    """Names that differ, times in [0, 1] that rise, something to train on; `index` is the file to name."""
    if not any(frame.split == "train" for frame in frames):
        raise InputError(f"{index}: has no training frame; at least one is needed")
    names = [frame.name for frame in frames]
    repeated = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    if repeated:
        raise InputError(f"{index}: frame name {sorted(repeated)[0]!r} stands twice")
    for before, after in pairwise(frames):
        if not before.t < after.t:
            raise InputError(f"{index}: t of frame {after.name!r} does not follow that of {before.name!r}")
    for frame in frames:
        if not 0.0 <= frame.t <= 1.0:
            raise InputError(f"{index}: t of frame {frame.name!r} is {frame.t}, outside [0, 1]")


def _inside(value: Any, what: str, index: Path) -> str:
    """A relative path that stays in the capture folder."""
    if not isinstance(value, str) or not value:
        raise InputError(f"{index}: {what} is missing or not a path")
    path = PurePosixPath(value)
    if path.is_absolute() or ".." in path.parts or "\\" in value or ":" in value:
        raise InputError(f"{index}: {what} is {value!r}, which leaves the capture folder")
    return value


def _list(document: dict[str, Any], key: str, index: Path) -> list[Any]:
    value = document.get(key)
    if not isinstance(value, list) or not value:
        raise InputError(f'{index}: key "{key}" is missing or empty')
    return value


def number_of(document: dict[str, Any], key: str, index: Path, label: str = "") -> float:
    """A finite number; `index` is the file to name where it is refused."""
    value = document.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        where = f" of {label}" if label else ""
        raise InputError(f'{index}: key "{key}"{where} must be a finite number, found {value!r}')
    return float(value)


def matrix_of(value: Any, shape: tuple[int, ...], what: str, index: Path) -> NDArray[np.float64]:
    """Finite numbers in that shape; `index` is the file to name where they are refused."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        size = "x".join(str(side) for side in shape)
        raise InputError(f"{index}: {what} is not a {size} matrix of numbers") from None
    if matrix.shape != shape:
        raise InputError(f"{index}: {what} has shape {matrix.shape}, expected {shape}")
    if not np.isfinite(matrix).all():
        raise InputError(f"{index}: {what} holds NaN or infinity")
    return matrix

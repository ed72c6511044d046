"""Truth of a rendered capture, and masks and boxes of footage, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aa4d.capture.reader import Capture
from aa4d.capture.schema import is_rigid
from aa4d.errors import InputError

BOXES = "movers/boxes.npz"
LEFT_OUT = "left_out"


@dataclass(frozen=True)
class ObjectTracks:
    """The M instances of a capture with truth, at its N frames."""

    names: tuple[str, ...]  # [M]
    instance_id: NDArray[np.uint32]  # [M]
    object_to_world: NDArray[np.float64]  # [N, M, 4, 4]; the origin is the center of the footprint, x forward
    moving: NDArray[np.bool_]  # [N, M]
    present: NDArray[np.bool_]  # [N, M]


@dataclass(frozen=True)
class Boxes:
    """Annotated boxes of a capture of footage, B of them, ordered by frame."""

    frame: NDArray[np.int64]  # [B] rank of the frame
    target: NDArray[np.int64]  # [B] the same number for the same object in every frame; -1: not followed
    box_px: NDArray[np.float64]  # [B, 4] left, top, right, bottom, cut at the frame's edges
    category: NDArray[np.str_]  # [B] "" where it is not known


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
        raise InputError(f"{path}: object_to_world must hold rigid motions; make the capture again")
    if len(np.unique(ids)) < len(ids):
        raise InputError(f"{path}: duplicate instance_id; make the capture again")
    names = tuple(capture.instance_names.get(int(i), f"instance {i}") for i in ids)
    return ObjectTracks(names, ids, poses, moving, present)


def left_out(capture: Capture, index: int) -> NDArray[np.bool_] | None:
    """Pixels [H, W] that somebody painted over in `left_out/NAME.png`, or for all frames in `left_out/all.png`; None
    where there is neither. Raises InputError for a picture that cannot be read or has another size."""
    masks = (_mask(capture, f"{LEFT_OUT}/{name}.png") for name in (capture.frames[index].name, "all"))
    there = [mask for mask in masks if mask is not None]
    return np.logical_or.reduce(there) if there else None


def _movers(capture: Capture, index: int) -> NDArray[np.bool_] | None:
    return _mask(capture, f"movers/{capture.frames[index].name}.png")


def _mask(capture: Capture, name: str) -> NDArray[np.bool_] | None:
    """Pixels [H, W] that are white in a picture of the capture; None where there is no such picture."""
    path = capture.folder / name
    if not path.is_file():
        return None
    try:
        with Image.open(path) as image:
            mask = np.array(image.convert("L")) > 127
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: mask cannot be read ({error}); make it again") from None
    expected = (capture.camera.height, capture.camera.width)
    if mask.shape != expected:
        raise InputError(f"{path}: mask has shape {mask.shape}, expected {expected}; make it again")
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

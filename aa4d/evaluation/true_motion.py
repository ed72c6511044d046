"""True motion from one frame to another: depth, instances and the instances' poses (docs/formats.md).

No flow pass is needed, and the frames need not be neighbours. Poses that were measured rather than known
(`viewmat_true` in the capture's index) do not enter: the truth belongs to the true ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.capture.schema import pose_of
from aa4d.capture.truth import object_tracks
from aa4d.files import read_json_object

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrueTracks:
    """M instances over the N frames of a capture, and the cameras that saw them."""

    folder: Path
    ids: NDArray[np.int64]  # [M]
    poses: Array  # [N, M, 4, 4] object to world
    moving: NDArray[np.bool_]  # [N, M]
    present: NDArray[np.bool_]  # [N, M]
    viewmats: Array  # [N, 4, 4] world to camera
    K: Array  # [3, 3]


@dataclass(frozen=True)
class TrueMotion:
    """Motion of the P pixels of a frame that show something that moves, to another frame."""

    rows: NDArray[np.int64]  # [P]
    columns: NDArray[np.int64]  # [P]
    instance: NDArray[np.int64]  # [P] row in `TrueTracks`
    displacement_m: Array  # [P, 3]
    flow_px: Array  # [P, 2] x right, y down
    camera_flow_px: Array  # [P, 2] what the camera alone would do to something that stands still there


def read_true_tracks(capture: Capture) -> TrueTracks | None:
    """None where the capture knows no instances.

    Raises:
        InputError: the file is missing, damaged, or of another number of frames.
    """
    truth = object_tracks(capture)
    if truth is None:
        return None
    return TrueTracks(
        folder=capture.folder,
        ids=truth.instance_id.astype(np.int64),
        poses=truth.object_to_world.astype(np.float64),
        moving=truth.moving.astype(bool),
        present=truth.present.astype(bool),
        viewmats=true_viewmats(capture),
        K=capture.camera.K,
    )


def true_viewmats(capture: Capture) -> Array:
    """World to camera of every frame, [N, 4, 4]; where the capture's own are measured ones, the true ones."""
    index = capture.folder / "capture.json"
    frames = read_json_object(index, "the index of a capture")["frames"]
    return np.stack(
        [
            pose_of(entry["viewmat_true"], f"frame {frame.name!r}", index) if "viewmat_true" in entry else frame.viewmat
            for entry, frame in zip(frames, capture.frames, strict=True)
        ]
    )


def instances_of(tracks: TrueTracks, instance_id: NDArray[np.uint32]) -> NDArray[np.int64]:
    """[H, W] rows in `tracks` of what the pixels show; -1: the world, or what has no track."""
    if not len(tracks.ids):
        return np.full(instance_id.shape, -1)
    order = np.argsort(tracks.ids)
    place = np.searchsorted(tracks.ids[order], instance_id).clip(max=len(order) - 1)
    rows = order[place]
    return np.where(tracks.ids[rows] == instance_id, rows, -1)


def true_motion(
    tracks: TrueTracks,
    depth_z: NDArray[np.float32],
    instance: NDArray[np.int64],
    start: int,
    end: int,
) -> TrueMotion:
    """Motion of the pixels of frame `start` whose instance moves at that instant, to frame `end`.

    What is not in the scene any more at `end`, or lies behind that camera, is left out; what leaves the picture or is
    hidden there is not.

    Args:
        depth_z: [H, W] metres, of frame `start`.
        instance: [H, W] from `instances_of`, of frame `start`.
    """
    moves = tracks.moving[start] & tracks.present[end]
    rows, columns = np.nonzero((instance >= 0) & np.append(moves, False)[instance] & np.isfinite(depth_z))
    who = instance[rows, columns]
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    rays = np.concatenate([pixels, np.ones((len(rows), 1))], axis=1) @ np.linalg.inv(tracks.K).T
    to_world = np.linalg.inv(tracks.viewmats[start])
    x = (rays * depth_z[rows, columns, None].astype(np.float64)) @ to_world[:3, :3].T + to_world[:3, 3]
    step = tracks.poses[end] @ np.linalg.inv(tracks.poses[start])  # [M, 4, 4]
    moved = np.einsum("pij,pj->pi", step[who, :3, :3], x) + step[who, :3, 3]
    there, ahead = _project(tracks, moved, end)
    stays, stays_ahead = _project(tracks, x, end)
    kept = ahead & stays_ahead
    return TrueMotion(
        rows=rows[kept],
        columns=columns[kept],
        instance=who[kept],
        displacement_m=(moved - x)[kept],
        flow_px=(there - pixels)[kept],
        camera_flow_px=(stays - pixels)[kept],
    )


def _project(tracks: TrueTracks, x: Array, frame: int) -> tuple[Array, NDArray[np.bool_]]:
    """[P, 2] pixels, and [P] whether they lie before the camera."""
    viewmat = tracks.viewmats[frame]
    in_camera = x @ viewmat[:3, :3].T + viewmat[:3, 3]
    ahead = in_camera[:, 2] > 1e-6
    pixels = in_camera @ tracks.K.T / np.where(ahead, in_camera[:, 2], 1)[:, None]
    return pixels[:, :2], ahead

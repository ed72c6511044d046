"""Tracks from a capture's truth: an oracle for experiments, used only where it is asked for by name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from aa4d.capture.reader import Capture
from aa4d.capture.truth import instance_ids_of, object_tracks
from aa4d.errors import InputError
from aa4d.motion.spline import controls_for, design
from aa4d.motion.tracks import ALWAYS, Array, Tracks

SEGMENT_S = 0.5
SHORTEST_WAY_M = 0.5  # what sways in the wind travels less between the frames that see it
RIM_PX = 3  # around a mover: its blurred outline
SMOOTH = 1e-6  # of the summed squared second differences: settles control points that no instant determines


def truth_tracks(capture: Capture, frames: list[int]) -> Tracks:
    """Everything that travels while training frames show it, on its true trajectory at all instants, held-out ones too.

    Args:
        frames: the training frames, whose pixels are labeled.

    Raises:
        InputError: the capture has no truth.
    """
    truth = object_tracks(capture)
    if truth is None or any(capture.frames[i].truth is None for i in frames):
        raise InputError(
            f"{capture.folder}: has no truth to take tracks from; use --tracks pictures, or a capture of `aa4d synth`"
        )
    position = truth.object_to_world[:, :, :3, 3]
    step_m = np.where(truth.present[1:] & truth.present[:-1], np.linalg.norm(np.diff(position, axis=0), axis=-1), 0)
    instances = [instance_ids_of(capture, i) for i in frames]
    seen = np.isin(truth.instance_id, np.unique(np.stack([ids for ids in instances if ids is not None])))
    moves = (truth.moving & truth.present).any(axis=0)
    movers = np.flatnonzero(seen & moves & (step_m.sum(axis=0) > SHORTEST_WAY_M))
    t = np.array([frame.t for frame in capture.frames])
    controls = controls_for(len(t), capture.fps, SEGMENT_S)
    poses = truth.object_to_world[:, movers]
    heading = np.unwrap(np.arctan2(poses[:, :, 1, 0], poses[:, :, 0, 0]), axis=0)
    values = np.concatenate([poses[:, :, :3, 3], heading[..., None]], axis=-1)  # [N, M, 4]
    control = np.stack(
        [_fit(t, values[:, m], truth.present[:, i], controls) for m, i in enumerate(movers)]
        or [np.zeros((controls, 4))]
    )[: len(movers)]
    ids = truth.instance_id[movers]
    labels = np.zeros((len(frames), capture.camera.height, capture.camera.width), np.uint16)
    moving = np.zeros(labels.shape, bool)
    for row, instance in enumerate(instances):
        for m, i in enumerate(ids):
            labels[row][instance == i] = m + 1
        moving[row] = binary_dilation(labels[row] > 0, iterations=RIM_PX)
    shown = np.array([_shown(t, truth.present[:, i]) for i in movers]).reshape(-1, 4)
    names = tuple(truth.names[i] for i in movers)
    return Tracks(names, control, shown, np.array([0.0, 0.0, 1.0]), labels, moving)


def _fit(t: Array, values: Array, present: NDArray[np.bool_], controls: int) -> Array:
    """[C, 4] control points by least squares over the instants at which the mover is there."""
    bend = np.diff(np.eye(controls), 2, axis=0) * np.sqrt(SMOOTH)
    matrix = np.concatenate([design(t[present], controls), bend])
    right = np.concatenate([values[present], np.zeros((len(bend), 4))])
    control: Array = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return control


def _shown(t: Array, present: NDArray[np.bool_]) -> tuple[float, float, float, float]:
    there = np.flatnonzero(present)
    step = 0.5 / max(len(t) - 1, 1)
    first, last = t[there[0]], t[there[-1]]
    appear = (first - step, first) if there[0] > 0 else ALWAYS[:2]
    vanish = (last, last + step) if there[-1] < len(t) - 1 else ALWAYS[2:]
    return (*appear, *vanish)

"""Scores of how well drawn motion matches that of the traffic (docs/evaluation.md defines every score)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import depth_of, instance_ids_of, moving_mask
from aa4d.evaluation.drawn_motion import drawn_motion
from aa4d.evaluation.flow_agreement import optical_flow
from aa4d.evaluation.group_error import FEWEST_PX, GroupError, group_error, group_pixels, match_frames
from aa4d.evaluation.motion_picture import motion_picture
from aa4d.evaluation.true_motion import TrueMotion, TrueTracks, instances_of, read_true_tracks, true_motion
from aa4d.methods.model_file import LoadedModel

SHORTEST_PATH_PX = 5.0  # over the clip, in the picture: what travels less has no ratio worth a name

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionScores:
    """None where there is nothing to measure it by."""

    motion_epe_px: float | None = None  # mean over moving pixels of held-out frames, to the next frame
    motion_epe_px_median: float | None = None
    motion_epe_px_static: float | None = None  # mean, of what stands still while the camera flies
    travel_ratio: float | None = None  # median over instances; 1: what is drawn travels as far as they do
    travel_instances: int = 0  # of the median
    groups: int = 0  # rigid groups of the model
    groups_matched: int = 0  # moving instances that have a group
    moving_instances: int | None = None
    group_error_m: float | None = None  # median at held-out times
    flow_agreement_px: float | None = None  # median on masked pixels of held-out frames; without truth
    flow_agreement_px_static: float | None = None  # likewise, the coarse stage


@dataclass(frozen=True)
class Motion:
    scores: MotionScores
    picture: NDArray[np.uint8] | None  # of one held-out frame, true and drawn motion


def motion_steps(loaded: LoadedModel, capture: Capture) -> int:
    """Number of times that `measure_motion` calls its progress."""
    matching = len(match_frames(capture)) if loaded.model.groups is not None else 0
    return len(capture.frames) - 1 + (matching if capture.tracks is not None else 0)


def measure_motion(
    loaded: LoadedModel, static: LoadedModel | None, capture: Capture, progress: Callable[[], None]
) -> Motion:
    """Motion by the truth of the capture, or by optical flow on its masks of movers.

    Args:
        static: the model of the coarse stage, in which only the camera moves.
        progress: called `motion_steps` times.

    Raises:
        InputError: truth, a mask or a picture is damaged.
    """
    tracks = read_true_tracks(capture)
    groups = 0 if loaded.model.groups is None else len(loaded.model.groups)
    if tracks is None:
        agreement, agreement_static = _flow_agreement(loaded, static, capture, progress)
        return Motion(
            MotionScores(groups=groups, flow_agreement_px=agreement, flow_agreement_px_static=agreement_static), None
        )
    instance_of = partial(_instances_in, capture, tracks)
    travels = Travels(len(tracks.ids))
    visible = np.zeros((len(capture.frames), len(tracks.ids)), np.int64)
    errors: list[Array] = []
    errors_still: list[Array] = []
    busiest: tuple[int, TrueMotion, Array] | None = None
    for index in range(len(capture.frames)):
        instance, depth = instance_of(index), depth_of(capture, index)
        if instance is not None:
            visible[index] = np.bincount(instance[instance >= 0], minlength=len(tracks.ids))
        if index + 1 == len(capture.frames):
            break
        truth = None if instance is None or depth is None else true_motion(tracks, depth, instance, index, index + 1)
        if truth is not None and len(truth.rows):
            drawn = drawn_motion(loaded, capture, index, index + 1)
            at = truth.rows, truth.columns
            travels.add(truth, drawn.displacement_m[at])
            if capture.frames[index].split == "test":
                # What shows nothing has no motion of its own: the camera's is all that is left.
                flow = np.where(drawn.shown[at][:, None], drawn.flow_px[at], truth.camera_flow_px)
                errors.append(np.linalg.norm(flow - truth.flow_px, axis=1))
                errors_still.append(np.linalg.norm(truth.camera_flow_px - truth.flow_px, axis=1))
                if busiest is None or len(truth.rows) > len(busiest[1].rows):
                    busiest = index, truth, flow
        progress()
    ratios = travels.ratios()
    group = _group_error(loaded, capture, tracks, instance_of, visible, progress)
    epe = np.concatenate(errors) if errors else None
    scores = MotionScores(
        motion_epe_px=None if epe is None else float(epe.mean()),
        motion_epe_px_median=None if epe is None else float(np.median(epe)),
        motion_epe_px_static=float(np.concatenate(errors_still).mean()) if errors_still else None,
        travel_ratio=float(np.median(ratios)) if len(ratios) else None,
        travel_instances=len(ratios),
        groups=groups,
        moving_instances=int((tracks.moving & (visible >= FEWEST_PX)).any(axis=0).sum()),
        groups_matched=0 if group is None else group.matched,
        group_error_m=float(np.median(group.errors_m)) if group is not None and len(group.errors_m) else None,
    )
    if busiest is None:
        return Motion(scores, None)
    index, truth, flow = busiest
    return Motion(scores, motion_picture(read_image(capture, capture.frames[index]), truth, flow))


class Travels:
    """Travel of instances, and of what is drawn on them along their way, summed over pairs of frames."""

    def __init__(self, instances: int) -> None:
        self._true_m = np.zeros(instances)
        self._true_px = np.zeros(instances)
        self._drawn_m = np.zeros(instances)

    def add(self, truth: TrueMotion, drawn_m: Array) -> None:
        """drawn_m: [P, 3] the drawn displacement at the pixels of `truth`."""
        for instance in np.unique(truth.instance):
            on = truth.instance == instance
            if on.sum() >= FEWEST_PX:
                way = truth.displacement_m[on].mean(axis=0)
                length = float(np.linalg.norm(way))
                if length > 0:
                    self._true_m[instance] += length
                    self._true_px[instance] += np.linalg.norm((truth.flow_px - truth.camera_flow_px)[on].mean(axis=0))
                    self._drawn_m[instance] += drawn_m[on].mean(axis=0) @ way / length

    def ratios(self) -> Array:
        """Score of the instances that travel far enough."""
        far = self._true_px >= SHORTEST_PATH_PX
        return self._drawn_m[far] / self._true_m[far]


def _instances_in(capture: Capture, tracks: TrueTracks, index: int) -> NDArray[np.int64] | None:
    ids = instance_ids_of(capture, index)
    return None if ids is None else instances_of(tracks, ids)


def _group_error(
    loaded: LoadedModel,
    capture: Capture,
    tracks: TrueTracks,
    instance_of: Callable[[int], NDArray[np.int64] | None],
    visible: NDArray[np.int64],
    progress: Callable[[], None],
) -> GroupError | None:
    groups = loaded.model.groups
    if groups is None:
        return None
    votes = group_pixels(loaded, capture, len(tracks.ids), instance_of, progress)
    return group_error(loaded, groups, capture, tracks, votes, visible)


def _flow_agreement(
    loaded: LoadedModel, static: LoadedModel | None, capture: Capture, progress: Callable[[], None]
) -> tuple[float | None, float | None]:
    """Median distance of drawn motion from optical flow, of the model and of its coarse stage."""
    distances: list[list[Array]] = [[], []]
    for index in range(len(capture.frames) - 1):
        frame, after = capture.frames[index : index + 2]
        mask = moving_mask(capture, index) if frame.split == "test" else None
        if mask is not None and mask.any():
            flow, believed = optical_flow(read_image(capture, frame), read_image(capture, after))
            for model, collected in zip((loaded, static), distances, strict=True):
                if model is not None:
                    drawn = drawn_motion(model, capture, index, index + 1)
                    at = mask & believed & drawn.shown
                    collected.append(np.linalg.norm(drawn.flow_px[at] - flow[at], axis=1))
        progress()
    medians = [float(np.median(np.concatenate(c))) if sum(len(d) for d in c) else None for c in distances]
    return medians[0], medians[1]

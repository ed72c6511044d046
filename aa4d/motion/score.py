"""How good found tracks are, against the truth of a synthetic capture (docs/formats.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.capture.truth import read_array
from aa4d.errors import InputError
from aa4d.motion.tracks import Tracks

LEAST_VISIBLE_PX = 20
FAIR = 0.25  # of a track's pixels
NEAR_PX = 4  # a shadow and the rim of a mover are no mistake of `moving`


@dataclass(frozen=True)
class TrackScore:
    vehicle_frames: int  # of movers with 20 visible pixels or more, in training frames, at instants when they move
    recall: float  # of those, inside a track of that vehicle
    vehicles: int  # that have such a frame
    missed: tuple[int, ...]  # instance ids without a track
    tracks: int
    false: tuple[int, ...]  # tracks that hold nothing that moves in this clip (`holds`)
    split: int  # tracks beyond the first of the same vehicle, at the same time
    merged: int  # tracks that hold a fair share of two vehicles
    position_error_m: float  # median at held-out times, a constant offset in the mover's frame removed; NaN: no match
    position_error_mean_m: float
    moving_recall: float  # of pixels of moving instances, in `Tracks.moving`
    moving_precision: float  # share of `Tracks.moving` within 4 px of a moving instance
    label_recall: float  # of those pixels, in the label of their own track
    label_precision: float  # share of labelled pixels on the instance of their track

    def line(self) -> str:
        found = self.vehicles - len(self.missed)
        return (
            f"vehicle-frames {self.recall:.3f} of {self.vehicle_frames}, vehicles {found}/{self.vehicles}, tracks "
            f"{self.tracks} ({len(self.false)} false, {self.split} split, {self.merged} merged), position "
            f"{self.position_error_m:.2f} m median {self.position_error_mean_m:.2f} m mean, moving px recall "
            f"{self.moving_recall:.2f} precision {self.moving_precision:.2f}, labels {self.label_recall:.2f} "
            f"{self.label_precision:.2f}"
        )


def score_tracks(tracks: Tracks, capture: Capture) -> TrackScore:
    """Match tracks to instances by the pixels of their labels.

    Raises:
        InputError: the capture has no truth, or tracks are not of its training frames.
    """
    from scipy.ndimage import binary_dilation

    if capture.tracks is None:
        raise InputError(f"{capture.folder}: has no true tracks; tracks can be scored on synthetic captures only")
    path = capture.folder / capture.tracks
    ids, moves = read_array(path, "instance_id"), read_array(path, "moving")
    poses = read_array(path, "object_to_world")
    train = capture.of_split("train")
    if len(tracks.labels) != len(train):
        raise InputError(f"{capture.folder}: has {len(train)} training frames, the tracks {len(tracks.labels)}")
    column = {int(number): i for i, number in enumerate(ids)}
    count = len(tracks)
    shared = np.zeros((count + 1, len(ids) + 1), np.int64)  # pixels; the last column: no instance
    shared_at = np.zeros((len(train), count + 1, len(ids) + 1), np.int64)
    visible = np.zeros((len(train), len(ids)), np.int64)
    caught = wanted = marked = near = 0
    for v, index in enumerate(train):
        instance = instances_of(capture, index, column, len(ids))
        pairs = tracks.labels[v].astype(np.int64) * (len(ids) + 1) + instance
        at = np.bincount(pairs.ravel(), minlength=shared.size).reshape(shared.shape)
        shared_at[v], shared = at, shared + at
        visible[v] = at.sum(0)[:-1]
        moving = np.append(moves[index], False)[instance]
        caught, wanted = caught + int((moving & tracks.moving[v]).sum()), wanted + int(moving.sum())
        around = binary_dilation(moving, iterations=NEAR_PX)
        marked, near = marked + int(tracks.moving[v].sum()), near + int((around & tracks.moving[v]).sum())
    movers = moves.any(0)
    on_movers = shared[1:, :-1] * movers
    owner = on_movers.argmax(1) if count else np.zeros(0, int)
    labelled = shared[1:].sum(1)
    there = (shared_at[:, 1:].sum(2) > 0).astype(np.int64)  # [V, count]
    seen = (there.T @ visible)[np.arange(count), owner]  # of its owner, in the frames of each track
    most = 2 * on_movers.sum(1) > labelled
    false = tuple(np.flatnonzero(~(most | holds(on_movers[np.arange(count), owner], labelled, seen))).tolist())
    true = [g for g in range(count) if g not in false]
    eligible = (visible >= LEAST_VISIBLE_PX) & moves[train]
    presence = tracks.presence(np.array([capture.frames[i].t for i in train])) if count else np.zeros((0, len(train)))
    inside = np.zeros_like(eligible)
    for g in true:
        # A track holds its vehicle where it is shown and where its label does not lie on something else.
        own = shared_at[:, g + 1, owner[g]]
        held = holds(own, shared_at[:, g + 1, :].sum(1), visible[:, owner[g]])
        inside[:, owner[g]] |= (presence[g] > 0.5) & held
    vehicles = np.flatnonzero(eligible.any(0))
    missed = tuple(int(ids[i]) for i in vehicles if not (inside & eligible)[:, i].any())
    errors = [_position_errors(tracks, g, poses[:, owner[g]], capture) for g in true]
    error = np.concatenate(errors) if errors else np.zeros(0)
    on_own = sum(int(on_movers[g, owner[g]]) for g in true)
    return TrackScore(
        vehicle_frames=int(eligible.sum()),
        recall=float((inside & eligible).sum() / max(eligible.sum(), 1)),
        vehicles=len(vehicles),
        missed=missed,
        tracks=count,
        false=false,
        split=_split(true, owner, presence),
        merged=sum(int((on_movers[g] > FAIR * labelled[g]).sum() > 1) for g in true),
        position_error_m=float(np.median(error)) if len(error) else float("nan"),
        position_error_mean_m=float(error.mean()) if len(error) else float("nan"),
        moving_recall=caught / max(wanted, 1),
        moving_precision=near / max(marked, 1),
        label_recall=on_own / max(int((visible * moves[train]).sum()), 1),
        label_precision=on_own / max(int(labelled.sum()), 1),
    )


def holds(own: NDArray[np.int64], labelled: NDArray[np.int64], visible: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether labels are on a mover: most of their pixels are, or most of its pixels are and a fair share of theirs.

    The second for people, whose shadows are larger than they are.
    """
    return (2 * own >= labelled) | ((2 * own >= visible) & (own >= FAIR * labelled) & (own > 0))


def instances_of(capture: Capture, index: int, column: dict[int, int], count: int) -> NDArray[np.int64]:
    """[H, W]: the column of the instance that each pixel of a frame shows; `count` where there is none."""
    truth = capture.frames[index].truth
    if truth is None:
        raise InputError(f"{capture.folder}: frame {capture.frames[index].name!r} has no truth")
    present, inverse = np.unique(read_array(capture.folder / truth, "instance_id"), return_inverse=True)
    columns = np.array([column.get(int(number), count) for number in present])
    return np.asarray(columns[inverse].reshape(capture.camera.height, capture.camera.width), np.int64)


def _split(true: list[int], owner: NDArray[np.int64], presence: NDArray[np.float64]) -> int:
    """Tracks that share at least two frames with a longer track of their vehicle."""
    split = 0
    order = sorted(true, key=lambda g: -presence[g].sum())
    for i, g in enumerate(order):
        split += any(owner[h] == owner[g] and ((presence[g] > 0.5) & (presence[h] > 0.5)).sum() > 1 for h in order[:i])
    return split


def _position_errors(tracks: Tracks, g: int, truth: NDArray[np.float64], capture: Capture) -> NDArray[np.float64]:
    """Metres across the ground at held-out times when the track is shown, in the true mover's frame."""
    times = np.array([capture.frames[i].t for i in range(len(capture.frames))])
    shown = np.flatnonzero(tracks.presence(times)[g] > 0.5)
    apart = tracks.poses(times[shown])[g][:, :3] - truth[shown, :3, 3]
    local = np.einsum("nji,nj->ni", truth[shown, :3, :3], apart)
    test = np.isin(shown, capture.of_split("test"))
    if not test.any():
        return np.zeros(0)
    return np.asarray(np.linalg.norm((local - np.median(local, axis=0))[test, :2], axis=1))

"""Rigid groups: anchors that ride on a mover's trajectory (docs/formats.md, "Rigid groups"). No bpy here.

A group turns about `up` by its heading and is shifted to its position; both are uniform cubic B-splines over the clip.
Poses are computed in float64, points are moved in their own precision.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Doubles = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.intp]

FEWEST_CONTROLS = 4
SHORTEST_RAMP = 1e-9  # of t
# Rows: the weights of four successive control points as polynomials 1, f, f^2, f^3 of the place f in a segment.
BASIS = np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]) / 6


@dataclass(frozen=True)
class Poses:
    """Where G groups are at one time, model frame."""

    position: Doubles  # [G, 3]
    heading: Doubles  # [G] radians
    up: Doubles  # [3] unit
    presence: Doubles  # [G] in [0, 1]; not drawn where 0

    def to_world(self, group: Indices, points: Floats) -> Floats:
        """Points [M, ..., 3] in the frames of the groups [M], in the model's frame."""
        turned = np.matmul(_rows(points), self._rotation()[group].transpose(0, 2, 1))
        return (turned + self.position[group, None]).reshape(points.shape).astype(np.float32)

    def to_group(self, group: Indices, points: Doubles) -> Floats:
        """Points [M, 3] or one point [3] of the model's frame in the frames of the groups [M]: [M, 3]."""
        beside = points - self.position[group]
        return np.einsum("mji,mj->mi", self._rotation()[group], beside).astype(np.float32)

    def turn(self, group: Indices, quaternions: Floats) -> Floats:
        """Rotations [M, K, 4] w x y z in the groups' axes, in the model's."""
        return product(self.quaternions()[group, None], quaternions)

    def quaternions(self) -> Doubles:
        """The groups' rotations [G, 4], w x y z."""
        half = 0.5 * self.heading[:, None]
        return np.concatenate([np.cos(half), np.sin(half) * self.up], axis=1)

    def _rotation(self) -> Doubles:
        """[G, 3, 3], Rodrigues' formula."""
        x, y, z = self.up
        across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        c, s = np.cos(self.heading)[:, None, None], np.sin(self.heading)[:, None, None]
        return c * np.eye(3) + s * across + (1 - c) * np.outer(self.up, self.up)


@dataclass(frozen=True)
class Groups:
    """The groups of a model and who rides on them."""

    names: tuple[str, ...]  # [G], for people
    control: Doubles  # [G, C, 4] control points: position in the model's frame, heading in radians
    reference: Doubles  # [G, 4] the pose at which a group's anchors are looked up in the field
    shown: Doubles  # [G, 4] times in t: appears over the first two, vanishes over the last two
    up: Doubles  # [3] unit
    of_anchor: Indices  # [N] the group of each anchor, -1 for those of the world
    riders: Indices  # [M] the anchors that belong to a group, ascending

    def at(self, t: float) -> Poses:
        """The poses at t; outside [0, 1] the ends of the trajectories hold."""
        segments = self.control.shape[1] - 3
        place = min(max(t, 0.0), 1.0) * segments
        first = min(int(place), segments - 1)
        f = place - first
        pose = np.einsum("k,gkd->gd", BASIS @ np.array([1.0, f, f * f, f**3]), self.control[:, first : first + 4])
        return Poses(pose[:, :3], pose[:, 3], self.up, self.presence(t))

    def at_reference(self) -> Poses:
        """The poses of the canonical scene, all of them shown."""
        return Poses(self.reference[:, :3], self.reference[:, 3], self.up, np.ones(len(self.reference)))

    def presence(self, t: float) -> Doubles:
        """The share [G] of its opacity that each group has at t."""
        appear, there, until, vanish = self.shown.T
        rising = (t - appear) / np.maximum(there - appear, SHORTEST_RAMP)
        falling = (vanish - t) / np.maximum(vanish - until, SHORTEST_RAMP)
        return np.clip(np.minimum(rising, falling), 0, 1)

    def within(self, part: slice) -> tuple[Indices, Indices]:
        """The riders of a slice of the anchors, counted from its beginning, and their groups."""
        first, last = self.riders.searchsorted([part.start, part.stop])
        rows = self.riders[first:last]
        return rows - part.start, self.of_anchor[rows]


def product(first: Doubles, second: Floats) -> Floats:
    """Hamilton's product of quaternions [..., 4] w x y z: the second turn, then the first."""
    a, b = first[..., :1], first[..., 1:]
    w, v = second[..., :1], second[..., 1:]
    real = a * w - (b * v).sum(axis=-1, keepdims=True)
    return np.concatenate([real, a * v + w * b + np.cross(b, v)], axis=-1).astype(np.float32)


def chord_error(groups: Groups, positions: Floats, times: Sequence[float]) -> float:
    """How far the riders are, at most, from the straight way between two of these times, model units.

    Judged half way between each two, of groups that are shown then; `positions` [N, 3] as in the file.
    """
    riders, of_rider = groups.riders, groups.of_anchor[groups.riders]
    worst = 0.0
    for before, after in itertools.pairwise(times):
        low, middle, high = (groups.at(t) for t in (before, (before + after) / 2, after))
        seen = (middle.presence > 0)[of_rider]
        if seen.any():
            at = [pose.to_world(of_rider[seen], positions[riders[seen]]) for pose in (low, middle, high)]
            worst = max(worst, float(np.linalg.norm(at[1] - (at[0] + at[2]) / 2, axis=1).max()))
    return worst


def _rows(points: Floats) -> Floats:
    """[M, ..., 3] as [M, n, 3]."""
    return points.reshape(len(points), -1, 3)

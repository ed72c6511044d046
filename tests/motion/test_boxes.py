"""Annotated boxes as tracks: a flight over flat ground with true boxes of cars that drive and one that is parked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from aa4d.capture.truth import Boxes
from aa4d.motion.boxes import box_tracks
from aa4d.motion.ground import project
from aa4d.motion.observations import Observations

WIDTH, HEIGHT, FOCAL, FRAMES = 320, 180, 260.0, 33
K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
LENGTH, BREADTH, TALL = 4.5, 1.8, 1.5
T = np.linspace(0, 1, FRAMES)
Array = NDArray[np.float64]


def camera(t: float) -> Array:
    """World to camera, an arc of 40 degrees 35 m up."""
    angle = np.radians(40 * (t - 0.5))
    center = np.array([30 * np.sin(angle), -30 * np.cos(angle), 35.0])
    ahead = -center / np.linalg.norm(center)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ center
    return viewmat


VIEWMATS = np.array([camera(t) for t in T])
DRIVING = {3: ((-12.0, -4.0), (12.0, 2.0)), 7: ((6.0, 9.0), (-2.0, -8.0))}  # target: from, to
PARKED = {5: ((4.0, 3.0), (4.0, 3.0))}


def place(way: tuple[tuple[float, float], tuple[float, float]], t: float) -> Array:
    start, end = np.array(way[0]), np.array(way[1])
    return np.array([*(start + t * (end - start)), 0.0])


def box_of(way: tuple[tuple[float, float], tuple[float, float]], rank: int) -> Array:
    """Around the eight corners of the car: left, top, right, bottom."""
    ahead = np.array([*np.subtract(way[1], way[0]), 0.0])
    ahead = ahead / np.linalg.norm(ahead) if ahead.any() else np.array([1.0, 0, 0])
    side = np.array([-ahead[1], ahead[0], 0])
    corners = [
        place(way, T[rank]) + x * LENGTH / 2 * ahead + y * BREADTH / 2 * side + np.array([0, 0, z])
        for x in (-1, 1)
        for y in (-1, 1)
        for z in (0, TALL)
    ]
    pixels, _ = project(np.array(corners), VIEWMATS[rank], K)
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def observed() -> Observations:
    """Training frames of a grey plane on which nothing differs from the static scene."""
    rank = np.array([i for i in range(FRAMES) if i % 8])
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    local = np.stack([(columns - K[0, 2]) / FOCAL, (rows - K[1, 2]) / FOCAL, np.ones_like(rows)], axis=-1)
    depth = []
    for viewmat in VIEWMATS[rank]:
        center = -viewmat[:3, :3].T @ viewmat[:3, 3]
        depth.append(-center[2] / (local @ viewmat[:3, :3])[..., 2])
    shape = (len(rank), HEIGHT, WIDTH, 3)
    return Observations(
        images=np.full(shape, 102, np.uint8),
        static_color=np.full(shape, 0.4, np.float32),
        static_depth_m=np.array(depth, np.float32),
        viewmat=VIEWMATS[rank],
        K=K,
        t=T[rank],
        rank=rank,
        frames=FRAMES,
        fps=10.0,
    )


def boxes(ways: dict[int, tuple[tuple[float, float], tuple[float, float]]], jitter_px: float = 0.5) -> Boxes:
    generator = np.random.default_rng(0)
    rows = [(rank, target, box_of(way, rank)) for target, way in ways.items() for rank in range(FRAMES)]
    return Boxes(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]) + generator.normal(0, jitter_px, (len(rows), 4)),
        np.array([""] * len(rows)),
    )


def test_cars_that_drive_are_tracked_and_a_parked_one_is_not() -> None:
    tracks = box_tracks(observed(), boxes(DRIVING | PARKED))
    assert tracks.names == ("target 3", "target 7")
    assert np.allclose(tracks.up, [0, 0, 1], atol=0.01)
    held_out = T[8:-1:8]
    for way, poses in zip(DRIVING.values(), tracks.poses(held_out), strict=True):
        off = poses[:, :3] - [place(way, t) for t in held_out]
        # A pixel covers 0.18 m. The middle of a box is a little off the car's, in all frames alike.
        assert np.linalg.norm(off, axis=1).max() < 0.6
        assert np.linalg.norm(off - off.mean(axis=0), axis=1).max() < 0.15
        ahead = np.subtract(way[1], way[0])
        assert np.cos(poses[:, 3] - np.arctan2(ahead[1], ahead[0])).min() > np.cos(np.radians(6))
    # Neither begins nor ends within the clip.
    assert (tracks.presence(T) == 1).all()


def test_held_out_boxes_are_not_looked_at() -> None:
    given = boxes(DRIVING)
    spoilt = replace(given, box_px=np.where((given.frame % 8 == 0)[:, None], [5.0, 5, 9, 9], given.box_px))
    assert np.array_equal(box_tracks(observed(), given).control, box_tracks(observed(), spoilt).control)


def test_labels_lie_in_the_boxes_on_what_differs() -> None:
    view = observed()
    given = boxes(DRIVING, jitter_px=0.0)
    left, top, right, bottom = box_of(DRIVING[3], int(view.rank[4])).round().astype(int)
    view.images[4, top:bottom, left : (left + right) // 2] = 220  # the half that is seen
    tracks = box_tracks(view, given)
    rows, columns = np.nonzero(tracks.labels[4] == 1)
    assert rows.min() >= top - 1
    assert rows.max() <= bottom
    assert columns.max() < (left + right) // 2
    assert len(rows) > 0.9 * (bottom - top) * ((right - left) // 2)
    # Nothing differs in the next frame: the box's middle part.
    assert 0 < (tracks.labels[5] == 1).sum() < (bottom - top + 2) * (right - left + 2)
    assert (tracks.moving >= (tracks.labels > 0)).all()


def test_a_target_that_comes_late_is_shown_from_then_on() -> None:
    given = boxes(DRIVING)
    late = (given.target != 7) | (given.frame >= 12)
    tracks = box_tracks(
        observed(), Boxes(*(getattr(given, k)[late] for k in ("frame", "target", "box_px", "category")))
    )
    presence = tracks.presence(T)
    assert (presence[0] == 1).all()
    assert presence[1, 11] == 0
    assert (presence[1, 12:] == 1).all()


def test_what_nobody_follows_has_no_track_but_may_move() -> None:
    given = boxes(DRIVING)
    tracks = box_tracks(observed(), replace(given, target=np.full(len(given.target), -1)))
    assert len(tracks) == 0
    assert tracks.control.shape[0] == tracks.shown.shape[0] == 0
    assert not tracks.labels.any()
    assert tracks.moving.any(axis=(1, 2)).all()


@pytest.mark.parametrize("kind", ["no boxes", "no ground", "one sighting"])
def test_where_too_little_is_known_there_are_no_tracks(kind: str) -> None:
    view, given = observed(), boxes(DRIVING)
    few = {"no boxes": given.frame < 0, "no ground": given.frame >= 0, "one sighting": given.frame == 5}[kind]
    if kind == "no ground":
        view = replace(view, static_depth_m=np.zeros_like(view.static_depth_m))
    tracks = box_tracks(view, Boxes(*(getattr(given, k)[few] for k in ("frame", "target", "box_px", "category"))))
    assert len(tracks) == 0

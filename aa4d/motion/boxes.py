"""Annotated boxes as tracks: who follows an object over the frames has linked its sightings already.

A box's middle is taken for the middle of the object, half its height above the ground: the bottom edge of a box lies in
front of an object that is seen from the side and on its far corner where it is seen from above. What stays wrong is
nearly the same in all frames, and refinement by rendering takes it out; the jitter of hand-drawn boxes is smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.truth import Boxes
from aa4d.motion.fit import Priors, Sightings, fit_track
from aa4d.motion.ground import Ground, find_ground, project
from aa4d.motion.observations import Observations
from aa4d.motion.spline import controls_for
from aa4d.motion.tracks import ALWAYS, Tracks

Array = NDArray[np.float64]

SEGMENT_S = 1.0  # of a trajectory
FEWEST = 2  # sightings
HEIGHT_SHARE = 0.35  # of a vehicle's length: cars 0.33, buses 0.27, vans 0.4
BOX_SD_PX = 1.0  # jitter of a box's middle
ACCELERATION = 0.7  # lengths per second squared: 3 m/s2 of a car
LEAST_SPEED_PX = 0.3  # a frame: slower, jitter decides about the direction of motion
STANDING_PX = 3.0  # from where one point in space would be seen: jitter, the drift of poses, other sides of the object
STANDING_SHARE = 95  # per cent of the boxes lie nearer than that, where an object stands
CUT_SHARE = 0.5  # of an object's size, by which what the picture's edge leaves of it may be off
HUBER_PX = 1.5
ROUNDS = 8  # of reweighting
DIFFERENCE = 0.06  # from the static scene, of a pixel that shows the mover
FEW_DIFFERENT = 0.25  # of a box's pixels: below, the mover looks like the road and the box decides
CORE_SHARE = 0.15  # of a box, on every side, that then is left out
BORDER_SHARE = 0.3  # of a box, on every side: shadows and blurred outlines may belong to the mover
EDGE_PX = 1.5  # a box so near to the picture's edge is cut by it


@dataclass(frozen=True)
class Seen:
    """Boxes of one target in training frames, S of them, in order."""

    view: NDArray[np.int64]  # [S] index among the observations
    box: Array  # [S, 4] left, top, right, bottom
    is_cut: NDArray[np.bool_]  # [S] by the picture's edge


def box_tracks(observed: Observations, boxes: Boxes) -> Tracks:
    """A track for every target that moves over the ground; boxes of held-out frames are not looked at.

    Where there is no ground, or nothing moves, there are no tracks.
    """
    shape = observed.images.shape[:3]
    labels, moving = np.zeros(shape, np.uint16), np.zeros(shape, bool)
    controls = controls_for(observed.frames, observed.fps, SEGMENT_S)
    ground = find_ground(observed.static_depth_m, observed.viewmat, observed.K)
    targets = seen_targets(observed, boxes)
    for target in [number for number in targets if number < 0]:  # not followed: it may move
        _mark(moving, targets.pop(target))
    found: dict[int, Array] = {}
    if ground is not None:
        for target, seen in targets.items():
            control = _trajectory(observed, ground, seen, controls)
            if control is not None:
                found[target] = control
    for target in found:
        _mark(moving, targets[target])
    numbers = {target: number for number, target in enumerate(found, 1)}
    # The smaller of two boxes is drawn over the larger.
    every = [
        (targets[target], i, number) for target, number in numbers.items() for i in range(len(targets[target].view))
    ]
    for seen, i, number in sorted(every, key=lambda row: -_area(row[0].box[row[1]])):
        _label(labels, observed, seen, i, number)
    return Tracks(
        names=tuple(f"target {target}" for target in found),
        control=np.array(list(found.values())).reshape(-1, controls, 4),
        shown=np.array([_shown(observed, targets[target]) for target in found]).reshape(-1, 4),
        up=np.array([0.0, 0.0, 1.0]) if ground is None else ground.up,
        labels=labels,
        moving=moving | (labels > 0),
    )


def seen_targets(observed: Observations, boxes: Boxes) -> dict[int, Seen]:
    """By target, in the order of their numbers, those that training frames show."""
    view_of = {int(rank): view for view, rank in enumerate(observed.rank)}
    trained = np.isin(boxes.frame, observed.rank)
    height, width = observed.images.shape[1:3]
    found = {}
    for target in np.unique(boxes.target[trained]):
        rows = np.flatnonzero(trained & (boxes.target == target))
        rows = rows[np.argsort(boxes.frame[rows], kind="stable")]
        if target >= 0:  # an object is in one place
            rows = rows[np.unique(boxes.frame[rows], return_index=True)[1]]
        box = boxes.box_px[rows]
        cut = (box[:, :2] < EDGE_PX).any(axis=1) | (box[:, 2:] > np.array([width, height]) - EDGE_PX).any(axis=1)
        found[int(target)] = Seen(np.array([view_of[int(f)] for f in boxes.frame[rows]], np.int64), box, cut)
    return found


def _trajectory(observed: Observations, ground: Ground, seen: Seen, controls: int) -> Array | None:
    """Control points [controls, 4] of a target; None where it stands, or too little is known."""
    size_px = (seen.box[:, 2:] - seen.box[:, :2]).max(axis=1)
    _, depth = _on_ground(observed, ground, seen, 0.0)
    pixel = depth / observed.K[0, 0]
    whole = np.isfinite(pixel) & ~seen.is_cut
    known = whole if whole.sum() >= FEWEST else np.isfinite(pixel)
    if known.sum() < FEWEST:
        return None
    length = float(np.median((size_px * pixel)[known]))
    position, _ = _on_ground(observed, ground, seen, 0.5 * HEIGHT_SHARE * length)
    known &= np.isfinite(position).all(axis=1)
    if known.sum() < FEWEST:
        return None
    rows = np.flatnonzero(known)
    px = float(np.median(pixel[rows]))
    start = np.median(position[rows], axis=0) + 0.5 * HEIGHT_SHARE * length * ground.up
    off_px = _from_one_place(observed, seen, known, start, px, length) - np.where(
        seen.is_cut, CUT_SHARE * length / px, 0
    )
    if np.percentile(off_px, STANDING_SHARE) < STANDING_PX:
        return None
    sightings = Sightings(
        t=observed.t[seen.view[rows]],
        position=position[rows],
        position_sd=np.where(seen.is_cut[rows], 0.25 * length, BOX_SD_PX * pixel[rows]),
        velocity=np.full((len(rows), 3), np.nan),
        velocity_sd=np.ones(len(rows)),
        heading=np.full(len(rows), np.nan),
    )
    priors = Priors(ACCELERATION * length / observed.fps**2, LEAST_SPEED_PX * px)
    return fit_track(sightings, controls, observed.frames, ground.up, priors)


def _from_one_place(
    observed: Observations, seen: Seen, known: NDArray[np.bool_], start: Array, pixel: float, length: float
) -> Array:
    """[S]: pixels from the boxes' middles to where the one point in space is seen that explains the `known` ones best.

    The height of an object is not known: on the ground, a parked one would seem to creep as the camera flies by. The
    point is near `start` [3], by about a length (world units); a pixel covers `pixel` of those.
    """
    middle = 0.5 * (seen.box[:, :2] + seen.box[:, 2:])
    viewmat = observed.viewmat[seen.view]
    local = np.concatenate([middle, np.ones((len(middle), 1))], axis=1) @ np.linalg.inv(observed.K).T
    rays = np.einsum("sji,sj->si", viewmat[:, :3, :3], local / np.linalg.norm(local, axis=1, keepdims=True))
    centers = -np.einsum("sji,sj->si", viewmat[:, :3, :3], viewmat[:, :3, 3])
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # [S, 3, 3] what of a point lies beside a ray
    weights, prior = known.astype(np.float64), (pixel / length) ** 2
    off = np.zeros(len(middle))
    for _ in range(ROUNDS):
        normal = np.einsum("s,sij->ij", weights, across) + prior * np.eye(3)
        point = np.linalg.solve(normal, np.einsum("s,sij,sj->i", weights, across, centers) + prior * start)
        seen_at = np.concatenate([project(point[None], view, observed.K)[0] for view in viewmat])
        off = np.nan_to_num(np.linalg.norm(seen_at - middle, axis=1), nan=np.inf)
        weights = known * HUBER_PX / np.maximum(off, HUBER_PX)
    return off


def _on_ground(observed: Observations, ground: Ground, seen: Seen, height: float) -> tuple[Array, Array]:
    """Under the middles of boxes, taken to lie `height` above the land: places on it [S, 3], and their depth_z [S]."""
    middle = 0.5 * (seen.box[:, :2] + seen.box[:, 2:])
    place, depth = np.full((len(middle), 3), np.nan), np.full(len(middle), np.nan)
    for i, view in enumerate(seen.view):
        raised = ground.lift(middle[i : i + 1], observed.viewmat[view], observed.K, height)
        if np.isfinite(raised).all():
            place[i] = ground.drop(raised)[0]
            depth[i] = project(raised, observed.viewmat[view], observed.K)[1][0]
    return place, depth


def _shown(observed: Observations, seen: Seen) -> Array:
    """From the training frame before the first box to that after the last, unless the picture's edge or the clip's end
    is the reason why there is no box beyond."""
    first, last = int(seen.view[0]), int(seen.view[-1])
    shown = np.array(ALWAYS)
    if first > 0 and not seen.is_cut[0]:
        shown[:2] = observed.t[first - 1], observed.t[first]
    if last < len(observed) - 1 and not seen.is_cut[-1]:
        shown[2:] = observed.t[last], observed.t[last + 1]
    return shown


def _mark(moving: NDArray[np.bool_], seen: Seen) -> None:
    for view, box in zip(seen.view, seen.box, strict=True):
        moving[view][_inside(box, BORDER_SHARE, moving.shape[1:])] = True


def _label(labels: NDArray[np.uint16], observed: Observations, seen: Seen, i: int, number: int) -> None:
    """Pixels of a box that differ from the static scene, or its middle part where few do."""
    view, box = int(seen.view[i]), seen.box[i]
    inside = _inside(box, 0.0, labels.shape[1:])
    image = observed.images[view][inside].astype(np.float32) / 255
    different = np.abs(image - observed.static_color[view][inside]).max(axis=2) > DIFFERENCE
    if different.mean() < FEW_DIFFERENT:
        labels[view][_inside(box, -CORE_SHARE, labels.shape[1:])] = number
    else:
        labels[view][inside][different] = number


def _inside(box: Array, grown: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns whose centres lie in a box, grown by that share of its size on every side; one at least."""
    border = grown * (box[2:] - box[:2])
    low = np.ceil(box[:2] - border - 0.5).astype(int)
    high = np.maximum(np.floor(box[2:] + border - 0.5).astype(int) + 1, low + 1)
    low = np.clip(low, 0, [shape[1] - 1, shape[0] - 1])
    high = np.clip(high, low + 1, [shape[1], shape[0]])
    return slice(low[1], high[1]), slice(low[0], high[0])


def _area(box: Array) -> float:
    return float((box[2:] - box[:2]).prod())

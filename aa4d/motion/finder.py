"""Movers and their tracks from the training frames alone.

The static stage's residual and flow against the static scene say where something may move; points are followed there
by flow, gathered into bodies that move as one, judged, joined over gaps, and fitted on the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aa4d.motion.bodies import (
    BESIDE,
    DIFFERING,
    LARGER,
    MISFIT_PX,
    Body,
    body_of,
    is_mover,
    linked,
    merged,
    pruned,
    trimmed,
    without_rims,
)
from aa4d.motion.clusters import clusters
from aa4d.motion.fit import Priors, Sightings, fit_track
from aa4d.motion.flow import measure
from aa4d.motion.ground import Ground, find_ground
from aa4d.motion.observations import Observations
from aa4d.motion.points import Points, follow, moving_pixels
from aa4d.motion.residual import differing, residuals
from aa4d.motion.spline import controls_for
from aa4d.motion.tracks import Tracks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]

SEGMENT_S = 0.5
HEIGHT = 0.4  # of a mover, over the root of the area that it covers on the ground as the camera sees it
LABEL_PX = 2.5  # from a followed point to a pixel that differs: both show the same mover
POINT_PX = 1.2  # what a point stands for by itself
BESIDE_PX = 6  # of what differs: what moves there may belong to it
AROUND_PX = 2  # what `moving` adds around a label
SHADOW_PX = 6  # how far from a label what differs may be its shadow
SHADE = (0.3, 0.9)  # of the static scene's colour: a shadow on it
SHADE_OFF = 0.03  # of [0, 1], that a shadow's colour may be off from that
SHADE_MOST = 0.6  # of a label; beyond, the mover itself is grey and dark
EDGE_PX = 2.5  # a label so near to the picture's edge is cut by it
BESIDE_EDGE = 4.0  # times the uncertainty of a centre that the edge cuts
POSITION_PX, VELOCITY_PX, ACCELERATION_PX = 3.0, 0.3, 1.5
HEADING_FROM_PX = 0.7  # a frame; slower, the direction of motion is noise


@dataclass(frozen=True)
class FinderSettings:
    fewest_frames: int = 2  # in which a mover is seen
    fewest_points: int = 4  # of a body, two pixels apart


def find_tracks(
    observed: Observations, settings: FinderSettings = FinderSettings(), progress: Say = lambda _: None
) -> Tracks:
    """Tracks of what moves; none where the frames show nothing that does."""
    ground = find_ground(observed.static_depth_m, observed.viewmat, observed.K) if len(observed) > 1 else None
    if ground is None:
        return no_tracks(observed)
    progress("what differs from the static scene")
    differs = differing(residuals(observed))
    if not differs.any():
        return no_tracks(observed)
    progress("optical flow")
    flow = measure(observed, differs)
    moves = moving_pixels(observed, flow, ground, widened(differs, BESIDE_PX))
    progress("following points")
    points = follow(observed, flow, ground, differs | moves, differs)
    bodies = find_bodies(points, observed.rank, settings)
    progress("tracks")
    labels = labelled(bodies, points, differs | moves)
    labels = without_shadows(observed, labels)
    alone = apart_from_larger(labels)
    keep = [g for g in alone if (labels == g + 1).any(axis=(1, 2)).sum() >= settings.fewest_frames]
    return assembled(observed, ground, [bodies[g] for g in keep], _renumbered(labels, keep), differs, moves)


def widened(masks: Mask, pixels: int) -> Mask:
    """[V, H, W]: with all that lies within so many pixels."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * pixels + 1,) * 2)
    return np.stack([cv2.dilate(mask.astype(np.uint8), kernel) > 0 for mask in masks])


def no_tracks(observed: Observations) -> Tracks:
    shape = observed.images.shape[:3]
    controls = controls_for(observed.frames, observed.fps, SEGMENT_S)
    return Tracks(
        (),
        np.zeros((0, controls, 4)),
        np.zeros((0, 4)),
        np.array([0.0, 0.0, 1.0]),
        np.zeros(shape, np.uint16),
        np.zeros(shape, bool),
    )


def find_bodies(points: Points, ranks: NDArray[np.int64], settings: FinderSettings) -> list[Body]:
    """Movers, each with all its points."""
    gaps = np.diff(ranks)
    number = clusters(points, gaps)
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(number[order])) + 1) if len(order) else []
    candidates = []
    for members in groups:
        if len(members) >= settings.fewest_points:
            body = trimmed(body_of(points, members, gaps), points, gaps)
            if body.number.max() >= settings.fewest_points and (body.number > 0).sum() > 1:
                candidates.append(body)
    # Fragments are judged after they were joined; what stands by itself does not lead a chain astray.
    parts = [b for b in candidates if b.misfit > 0.6 * MISFIT_PX and b.differing > 0.5 * DIFFERING]
    joined = merged(linked(parts, points, ranks), points, gaps)
    return without_rims([b for b in (pruned(b, points, gaps) for b in joined) if is_mover(b, points, gaps)], points)


def labelled(bodies: list[Body], points: Points, candidates: Mask) -> NDArray[np.uint16]:
    """[V, H, W]: of pixels near a followed point, the number of its body from 1."""
    views, height, width = candidates.shape
    labels = np.zeros((views, height, width), np.uint16)
    for v in range(views):
        at, owner = [], []
        for g, body in enumerate(bodies):
            if body.number[v]:
                pixels = body.pixels(points, v)
                at.append(pixels)
                owner.append(np.full(len(pixels), g + 1))
        if not at:
            continue
        near = np.zeros((height, width), np.uint8)
        every = np.concatenate(at)
        column, row = np.floor(every).astype(int).T
        near[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = 1
        reach = cv2.dilate(near, np.ones((7, 7), np.uint8))
        rows, columns = np.nonzero(reach)
        distance, nearest = cKDTree(every).query(np.stack([columns, rows], axis=1) + 0.5)
        mine = (distance < POINT_PX) | ((distance < LABEL_PX) & candidates[v][rows, columns])
        labels[v][rows[mine], columns[mine]] = np.concatenate(owner)[nearest[mine]]
    return labels


def without_shadows(observed: Observations, labels: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Labels less pixels that show the static scene, only darker; all of a mover's where they are most of it."""
    result = labels.copy()
    for v, label in enumerate(labels):
        rows, columns = np.nonzero(label)
        if not len(rows):
            continue
        image = cv2.GaussianBlur(observed.images[v].astype(np.float32) / 255, (0, 0), 0.8)[rows, columns]
        static = cv2.GaussianBlur(observed.static_color[v], (0, 0), 0.8)[rows, columns]
        share = (image * static).sum(1) / np.maximum((static * static).sum(1), 1e-6)
        off = np.abs(image - share[:, None] * static).max(axis=1)
        shadow = (share > SHADE[0]) & (share < SHADE[1]) & (off < SHADE_OFF)
        number = label[rows, columns]
        total = np.bincount(number, minlength=int(labels.max()) + 1)
        dark = np.bincount(number, shadow, minlength=len(total))
        shadow &= (dark < SHADE_MOST * total)[number]
        result[v][rows[shadow], columns[shadow]] = 0
    return result


def apart_from_larger(labels: NDArray[np.uint16]) -> list[int]:
    """Bodies, from 0, whose labels do not lie mostly beside far larger ones: those are their shadows and rims."""
    count = int(labels.max())
    near, total = np.zeros(count + 1), np.zeros(count + 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SHADOW_PX + 1,) * 2)
    for label in labels:
        size = np.bincount(label.ravel(), minlength=count + 1)
        size[0] = 0
        total += size
        here = np.flatnonzero(size)
        for g in here:
            larger = here[size[here] >= LARGER * size[g]]
            if len(larger):
                around = cv2.dilate(np.isin(label, larger).astype(np.uint8), kernel) > 0
                near[g] += (around & (label == g)).sum()
    return [g - 1 for g in range(1, count + 1) if near[g] < BESIDE * total[g]]


def _renumbered(labels: NDArray[np.uint16], keep: list[int]) -> NDArray[np.uint16]:
    table = np.zeros(int(labels.max()) + 1, np.uint16)
    for new, old in enumerate(keep):
        table[old + 1] = new + 1
    return np.asarray(table[labels])


def assembled(
    observed: Observations, ground: Ground, bodies: list[Body], labels: NDArray[np.uint16], differs: Mask, moves: Mask
) -> Tracks:
    """Fit every body on the ground, and say what may show a mover."""
    controls = controls_for(observed.frames, observed.fps, SEGMENT_S)
    control = np.zeros((len(bodies), controls, 4))
    shown = np.zeros((len(bodies), 4))
    for g, body in enumerate(bodies):
        sightings = sightings_of(observed, ground, body, labels == g + 1)
        pixel = observed.pixel
        priors = Priors(ACCELERATION_PX * pixel, HEADING_FROM_PX * pixel)
        control[g] = fit_track(sightings, controls, observed.frames, ground.up, priors)
        shown[g] = shown_of(observed, labels == g + 1)
    return Tracks(
        tuple(f"mover {g + 1}" for g in range(len(bodies))),
        control,
        shown,
        ground.up,
        labels,
        may_move(labels > 0, differs, moves),
    )


def sightings_of(observed: Observations, ground: Ground, body: Body, label: Mask) -> Sightings:
    """Where one mover is on the ground in the frames that show it, and how it moves there."""
    pixel = observed.pixel
    seen = np.flatnonzero(label.any(axis=(1, 2)))
    height, width = label.shape[1:]
    areas, cut = [], []
    for v in seen:
        rows, columns = np.nonzero(label[v])
        depth = observed.static_depth_m[v][rows, columns]
        depth = depth[depth > 0]
        size = float(np.median(depth)) / float(observed.K[0, 0]) if len(depth) else pixel
        areas.append(len(rows) * size**2)
        margin = min(rows.min(), columns.min(), height - 1 - rows.max(), width - 1 - columns.max())
        cut.append(margin < EDGE_PX)
    tall = HEIGHT * float(np.sqrt(np.percentile(areas, 80)))
    position = np.full((len(seen), 3), np.nan)
    for k, v in enumerate(seen):
        rows, columns = np.nonzero(label[v])
        center = np.array([[columns.mean() + 0.5, rows.mean() + 0.5]])
        position[k] = ground.drop(ground.lift(center, observed.viewmat[v], observed.K, tall / 2))[0]
    # The share of a mover that is seen says how far its centre can be trusted.
    part = np.sqrt(np.max(areas) / np.maximum(areas, 1e-12))
    position_sd = POSITION_PX * pixel * np.clip(part, 1, 4) * np.where(cut, BESIDE_EDGE, 1)
    velocity = np.full((len(seen), 3), np.nan)
    velocity_sd = np.full(len(seen), VELOCITY_PX * pixel)
    times = observed.t[seen].astype(np.float64)
    # Flow tells the mean velocity over a step: that of its middle.
    steps = np.flatnonzero(np.isfinite(body.velocity[:, 0]))
    middle = (observed.t[steps] + observed.t[steps + 1]) / 2
    along = body.velocity[steps] @ ground.axes * pixel
    here = np.array([position[np.argmin(np.abs(times - m))] for m in middle]).reshape(-1, 3)
    known = np.isfinite(here).all(1)
    rise = np.zeros(len(middle))
    if known.any():
        rise[known] = ground.height_at(here[known] + along[known]) - ground.height_at(here[known])
    along = along + rise[:, None] * ground.up
    good = np.isfinite(position).all(1)
    order = np.argsort(np.concatenate([times[good], middle]), kind="stable")
    nothing = np.full((len(middle), 3), np.nan)
    return Sightings(
        np.concatenate([times[good], middle])[order],
        np.concatenate([position[good], nothing])[order],
        np.concatenate([position_sd[good], np.ones(len(middle))])[order],
        np.concatenate([velocity[good], along])[order],
        np.concatenate([velocity_sd[good], np.full(len(middle), VELOCITY_PX * pixel)])[order],
        np.full(int(good.sum()) + len(middle), np.nan),
    )


def shown_of(observed: Observations, label: Mask) -> Array:
    """[4] as in `Tracks.shown`: a frame beyond the sightings, and half a frame to fade, inside the picture."""
    seen = np.flatnonzero(label.any(axis=(1, 2)))
    first, last = int(seen[0]), int(seen[-1])
    frame = 1 / max(observed.frames - 1, 1)
    start = [-2.0, -1.0] if first == 0 or _at_edge(label[first]) else None
    end = [2.0, 3.0] if last == len(label) - 1 or _at_edge(label[last]) else None
    t0, t1 = float(observed.t[first]), float(observed.t[last])
    start = start or [t0 - 1.5 * frame, t0 - frame]
    end = end or [t1 + frame, t1 + 1.5 * frame]
    return np.array(start + end)


def _at_edge(label: Mask) -> bool:
    rows, columns = np.nonzero(label)
    height, width = label.shape
    return bool(min(rows.min(), columns.min(), height - 1 - rows.max(), width - 1 - columns.max()) < EDGE_PX)


def may_move(tracked: Mask, differs: Mask, moves: Mask) -> Mask:
    """[V, H, W]: labels with a rim, what differs beside them, and what differs and moves elsewhere."""
    result = np.zeros_like(tracked)
    rim = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * AROUND_PX + 1,) * 2)
    beside = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SHADOW_PX + 1,) * 2)
    for v in range(len(tracked)):
        label = tracked[v].astype(np.uint8)
        _, regions = cv2.connectedComponents(differs[v].astype(np.uint8), connectivity=8)
        size = np.bincount(regions.ravel())
        share = np.bincount(regions.ravel(), moves[v].ravel()) / np.maximum(size, 1)
        untracked = (size >= 12) & (share > 0.2)
        untracked[0] = False
        loose = untracked[regions] | (differs[v] & (cv2.dilate(label, beside) > 0))
        result[v] = cv2.dilate((tracked[v] | loose).astype(np.uint8), rim) > 0
    return result

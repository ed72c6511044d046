"""Movers and their tracks from the training frames alone.

The static stage's residual and flow against the static scene say where something may move; points are followed there
by flow, gathered into bodies that move as one, judged, joined over gaps, and fitted on the ground.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.motion.bodies import (
    DIFFERING,
    FEWEST_POINTS,
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
from aa4d.motion.carried import carries, softened, stands
from aa4d.motion.clusters import clusters
from aa4d.motion.flow import measure
from aa4d.motion.ground import Ground, find_ground
from aa4d.motion.labels import apart_from_larger, footprints, labels_of, may_move, renumbered
from aa4d.motion.looks import joined
from aa4d.motion.observations import Observations
from aa4d.motion.points import Points, follow, moving_pixels
from aa4d.motion.residual import differing, residuals, shaded
from aa4d.motion.sightings import shown_of, trajectory
from aa4d.motion.spline import controls_for
from aa4d.motion.tracks import Tracks

Mask = NDArray[np.bool_]

SEGMENT_S = 0.5
BESIDE_PX = 6  # of what differs: what moves there may belong to it
FEWEST_FRAMES = 2  # in which a mover is seen


def find_tracks(observed: Observations, earlier: Tracks | None = None) -> Tracks:
    """Tracks of what moves; none where the frames show nothing that does.

    Args:
        earlier: of a first look at the same frames, on a static scene that had seen the movers.
    """
    ground = find_ground(observed.static_depth_m, observed.viewmat, observed.K) if len(observed) > 1 else None
    if ground is None:
        return no_tracks(observed)
    differs = differing(residuals(observed))
    if not differs.any():
        return no_tracks(observed)
    flow = measure(observed, differs)
    moves = moving_pixels(observed, flow, ground, widened(differs, BESIDE_PX))
    points = follow(observed, flow, ground, differs | moves, differs)
    bodies = [b for b in find_bodies(points, observed.rank) if not stands(b, points, observed, ground)]
    if earlier is not None:
        # Not at the first look: what is missed then is learned into the clean scene, what is false there is not kept.
        soft = softened(observed.images)
        bodies = [b for b in bodies if carries(b, points, observed, ground, soft)]
    bodies = without_rims(bodies, points)
    shade = shaded(observed)
    labels = labels_of(bodies, points, differs, shade)
    alone = apart_from_larger(labels)
    keep = [g for g in alone if (labels == g + 1).any(axis=(1, 2)).sum() >= FEWEST_FRAMES]
    kept, labels = [bodies[g] for g in keep], renumbered(labels, keep)
    moving = may_move((labels > 0) | footprints(kept, points, labels.shape), differs, moves)
    found = assembled(observed, ground, kept, labels, moving)
    return found if earlier is None else joined(earlier, found, differs & ~shade)


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


def find_bodies(points: Points, ranks: NDArray[np.int64]) -> list[Body]:
    """Bodies that get somewhere, each with all its points."""
    gaps = np.diff(ranks)
    number = clusters(points, gaps)
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(number[order])) + 1) if len(order) else []
    candidates = []
    for members in groups:
        if len(members) >= FEWEST_POINTS:
            body = trimmed(body_of(points, members, gaps), points, gaps)
            if body.number.max() >= FEWEST_POINTS and (body.number > 0).sum() > 1:
                candidates.append(body)
    # Fragments are judged after they were joined; what stands by itself does not lead a chain astray.
    parts = [b for b in candidates if b.misfit > 0.6 * MISFIT_PX and b.differing > 0.5 * DIFFERING]
    wholes = merged(linked(parts, points, ranks), points, gaps)
    return [b for b in (pruned(b, points, gaps) for b in wholes) if is_mover(b, points, gaps)]


def assembled(
    observed: Observations, ground: Ground, bodies: list[Body], labels: NDArray[np.uint16], moving: Mask
) -> Tracks:
    """Every body, fitted on the ground."""
    controls = controls_for(observed.frames, observed.fps, SEGMENT_S)
    control = np.zeros((len(bodies), controls, 4))
    shown = np.zeros((len(bodies), 4))
    for g, body in enumerate(bodies):
        control[g] = trajectory(observed, ground, body, labels == g + 1, controls)
        shown[g] = shown_of(observed, labels == g + 1)
    return Tracks(
        tuple(f"mover {g + 1}" for g in range(len(bodies))),
        control,
        shown,
        ground.up,
        labels,
        moving,
    )

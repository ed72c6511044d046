"""From the labels of a mover to its trajectory on the ground, and to when it is shown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.bodies import Body
from aa4d.motion.fit import Priors, Sightings, fit_track
from aa4d.motion.ground import Ground
from aa4d.motion.observations import Observations

HEIGHT = 0.4  # of a mover, over the root of the area that it covers on the ground as the camera sees it
EDGE_PX = 2.5  # a label so near to the picture's edge is cut by it
BESIDE_EDGE = 4.0  # times the uncertainty of a centre that the edge cuts
POSITION_PX, VELOCITY_PX, ACCELERATION_PX = 3.0, 0.3, 1.5
HEADING_FROM_PX = 0.7  # a frame; slower, the direction of motion is noise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def trajectory(observed: Observations, ground: Ground, body: Body, label: Mask, controls: int) -> Array:
    """Control points [controls, 4] of a mover that shows in `label` [V, H, W]."""
    priors = Priors(ACCELERATION_PX * observed.pixel, HEADING_FROM_PX * observed.pixel)
    return fit_track(sightings_of(observed, ground, body, label), controls, observed.frames, ground.up, priors)


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

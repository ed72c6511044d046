"""The other explanation of a followed point: it stands still in space, at some height over the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.ground import Ground
from aa4d.motion.observations import Observations

PRIOR = 1e-3  # weight of the surface that the static scene shows, beside a view: decides where there is no baseline
SLACK_PX = 6.0  # that a standing point may lie under the ground or above the surface, in pixels of the median depth
SLACK = 0.3  # and more, of the surface's height

Array = NDArray[np.float64]


def misfit(observed: Observations, ground: Ground, pixels: NDArray[np.float32]) -> Array:
    """[N]: pixels by which points [N, V, 2] miss the best point that stands, 90th percentile over their frames.

    A standing point lies between the ground and the surface that the static scene shows there, with some slack: parts
    of a facade or a tree that the static depth has wrong are explained, a car that drives as the drone flies is not,
    for it would have to hover in mid-air or lie deep in the ground.
    """
    count, views = pixels.shape[:2]
    alive = np.isfinite(pixels[..., 0])
    K = observed.K
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    surface, land = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    height, width = observed.static_depth_m.shape[1:]
    top = np.full(count, -np.inf)
    for v in range(views):
        here = np.flatnonzero(alive[:, v])
        if not len(here):
            continue
        at = pixels[here, v].astype(np.float64)
        view = observed.viewmat[v]
        center = -view[:3, :3].T @ view[:3, 3]
        local = np.concatenate([(at - K[[0, 1], [2, 2]]) / K[[0, 1], [0, 1]], np.ones((len(at), 1))], axis=1)
        rays = local @ view[:3, :3]
        unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - unit[:, :, None] * unit[:, None]
        normal[here] += across
        right[here] += across @ center
        column, row = np.floor(at).astype(int).T
        depth = observed.static_depth_m[v][np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
        shown = center + rays * np.where(depth > 0, depth, np.nan)[:, None]
        top[here] = np.fmax(top[here], np.nan_to_num(ground.above(np.nan_to_num(shown)), nan=0.0))
        new = here[np.isnan(land[here, 0])]
        fresh = np.isin(here, new)
        surface[new] = shown[fresh]
        land[new] = ground.lift(at[fresh], view, K)
    start = np.where(np.isfinite(surface), surface, land)
    known = np.isfinite(start).all(1)
    start = np.where(known[:, None], start, ground.origin)
    best = np.linalg.solve(normal + PRIOR * np.eye(3), (right + PRIOR * start)[..., None])[..., 0]
    slack = SLACK_PX * observed.pixel
    low, high = -slack, np.maximum(top, 0) * (1 + SLACK) + slack
    over = ground.above(best)
    error = np.full((count, views), np.nan)
    # Out of bounds, it slides along the ray of its first view.
    ray = start - (-observed.viewmat[0, :3, :3].T @ observed.viewmat[0, :3, 3])
    falling = ray @ ground.up
    excess = np.where(over < low, over - low, np.where(over > high, over - high, 0.0))
    best = best - ray * (excess / np.where(np.abs(falling) > 1e-9, falling, -1.0))[:, None]
    for v in range(views):
        here = np.flatnonzero(alive[:, v])
        view = observed.viewmat[v]
        local = best[here] @ view[:3, :3].T + view[:3, 3]
        z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
        seen = local[:, :2] / z[:, None] * K[[0, 1], [0, 1]] + K[[0, 1], [2, 2]]
        error[here, v] = np.nan_to_num(np.linalg.norm(seen - pixels[here, v], axis=1), nan=1e3)
    return np.asarray(np.nanpercentile(error, 90, axis=1)) if count else np.zeros(0)

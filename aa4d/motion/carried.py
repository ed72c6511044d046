"""What the pictures say of a body: does its motion carry them from frame to frame clearly better than standing still?

Flow slips along edges, over blank walls and where one thing hides another; the points that it drags along move, and
what they show does not. This asks the pictures themselves, over baselines at which the two explanations differ.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.motion.bodies import BRIEF_FRAMES, MISFIT_PX, Body
from aa4d.motion.flow import sample
from aa4d.motion.ground import Ground
from aa4d.motion.observations import Observations
from aa4d.motion.points import Points, standing
from aa4d.motion.standing import misfit

APART_PX = 2.0  # between the two explanations, median over the points
BASELINES = (1, 2, 4, 8, 16, 32)  # training frames: the shortest at which the explanations are so far apart
LOOKS = 12  # frames from which a body is carried, at most
MOST_POINTS = 64  # of a body
CLEARLY = 0.55  # of the difference that standing still leaves: what moves leaves less
GAIN = (0.5, 2.0)  # of the light that falls on a body: it drives into the shade and out of it
BLUR_PX = 0.7
PATCH = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


def softened(images: NDArray[np.uint8]) -> Floats:
    """[V, H, W, 3] in [0, 255]: without what flow's last half a pixel changes."""
    return np.stack([cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_PX) for image in images])


def stands(body: Body, points: Points, observed: Observations, ground: Ground) -> bool:
    """Whether its points, while they are on it, are explained by points that stand still; few frames cannot say."""
    if int((body.number > 0).sum()) < BRIEF_FRAMES:
        return False
    pixels = np.where(body.on[..., None], points.pixels[body.members], np.nan)[body.on.sum(1) > 1]
    return len(pixels) > 0 and float(np.median(misfit(observed, ground, pixels))) < MISFIT_PX


def carries(body: Body, points: Points, observed: Observations, ground: Ground, soft: Floats) -> bool:
    """Whether the pictures go with a body rather than with what stands; true where the two never part.

    Args:
        soft: `softened` images.
    """
    moving, still, number = comparisons(body, points, observed, ground, soft).T
    if not number.sum():
        return True
    return bool((number * moving).sum() < CLEARLY * (number * still).sum())


def comparisons(body: Body, points: Points, observed: Observations, ground: Ground, soft: Floats) -> Array:
    """[C, 3]: the mean difference that its motion leaves, that standing still leaves, and of how many points."""
    frames = np.flatnonzero(body.on.sum(0) >= 2)
    found = []
    for a in frames[:: max(len(frames) // LOOKS, 1)]:
        for step in BASELINES:
            b = int(a) + step
            if b >= len(soft):
                break
            both = np.flatnonzero(body.on[:, a] & body.on[:, b])
            if len(both) < 2:
                continue
            members = body.members[both[:: -(-len(both) // MOST_POINTS)]]
            here, there = (points.pixels[members, v].astype(np.float64) for v in (a, b))
            ways = [np.where(np.isfinite(way), way, np.inf) for way in standing(observed, ground, int(a), b, here)]
            apart = np.minimum.reduce([np.linalg.norm(there - here - way, axis=1) for way in ways])
            if np.median(apart) < APART_PX:
                continue
            moving = _difference(soft, int(a), b, here, there)
            still = min(_difference(soft, int(a), b, here, here + way) for way in ways)
            found.append((moving, still, float(len(here))))
            break
    return np.array(found).reshape(-1, 3)


def _difference(soft: Floats, a: int, b: int, here: Array, there: Array) -> float:
    """Mean over patches at `here` in frame a and `there` in frame b, lit alike; inf where no place is known."""
    known = np.isfinite(there).all(axis=1)
    if not known.any():
        return np.inf
    first, second = (sample(soft[v], (at[known] + PATCH[:, None]).reshape(-1, 2)) for v, at in ((a, here), (b, there)))
    gain = np.clip((first * second).sum() / max(float((second * second).sum()), 1e-6), *GAIN)
    return float(np.abs(first - gain * second).mean())

"""Trajectories from sightings: robust, regularised least squares for the control points of a track.

Velocities carry the curve and positions anchor it: the centre of what is seen of a mover shifts as other parts of it
come into view, while its velocity does not care. A penalty on acceleration determines what nobody saw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.spline import design

Array = NDArray[np.float64]

HUBER = 1.5  # standard deviations at which a residual begins to count linearly
ROUNDS = 8  # of reweighting
REVERSAL_RAD = 0.7 * np.pi  # a sharper turn between two looks is a vehicle that backs up
HEADING_SD_RAD = 0.1
TURN_SD_RAD = 0.5  # of the change of the turning rate, a clip frame
DRIFT_SD_RAD = 2.0  # of the turning rate, a clip frame: holds the heading where nothing tells it


@dataclass(frozen=True)
class Sightings:
    """What is known of one mover at S times; NaN where a value is not known."""

    t: Array  # [S] in [0, 1], increasing
    position: Array  # [S, 3] its origin on the ground, world units
    position_sd: Array  # [S] world units
    velocity: Array  # [S, 3] world units a clip frame
    velocity_sd: Array  # [S]
    heading: Array  # [S] radians, any branch


@dataclass(frozen=True)
class Priors:
    """What a mover may do, in world units and clip frames."""

    acceleration_sd: float  # world units a frame squared
    least_speed: float  # world units a frame: slower, the direction of motion says nothing about the heading


def plane_axes(up: Array) -> Array:
    """[2, 3]: two unit vectors across `up`; headings count from the first, towards the second."""
    start = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    first = start - start @ up * up
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def fit_track(sightings: Sightings, controls: int, clip_frames: int, up: Array, priors: Priors) -> Array:
    """Control points [controls, 4]: x, y, z in world units, heading in radians, unwrapped.

    Args:
        clip_frames: frames of the whole clip, held-out ones included; t = 1 is the last.
    """
    position = _fit_position(sightings, controls, clip_frames, priors)
    heading = _fit_heading(sightings, position, clip_frames, up, priors)
    return np.concatenate([position, heading[:, None]], axis=1)


def _fit_position(s: Sightings, controls: int, clip_frames: int, priors: Priors) -> Array:
    frame = 1 / max(clip_frames - 1, 1)
    seen, fast = np.isfinite(s.position).all(1), np.isfinite(s.velocity).all(1)
    places = design(s.t[seen], controls) / s.position_sd[seen, None]
    rates = design(s.t[fast], controls, 1) * frame / s.velocity_sd[fast, None]
    smooth = design(np.linspace(0, 1, clip_frames), controls, 2) * frame**2 / priors.acceleration_sd
    # A whisper of "stay where you are" settles what a single sighting without velocity leaves open.
    still = design(np.linspace(0, 1, clip_frames), controls, 1) * frame * (1e-3 / priors.acceleration_sd)
    origin = s.position[seen].mean(0)
    data = np.concatenate(
        [(s.position[seen] - origin) / s.position_sd[seen, None], s.velocity[fast] / s.velocity_sd[fast, None]]
    )
    rows = np.concatenate([places, rates])
    prior = np.concatenate([smooth, still])
    weights = np.ones(len(rows))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)[:, None]
        system = np.concatenate([rows * root, prior])
        target = np.concatenate([data * root, np.zeros((len(prior), 3))])
        solution = np.linalg.lstsq(system, target, rcond=None)[0]
        size = np.linalg.norm(rows @ solution - data, axis=1)
        weights = HUBER / np.maximum(size, HUBER)
    return np.asarray(solution + origin, np.float64)


def _fit_heading(s: Sightings, position: Array, clip_frames: int, up: Array, priors: Priors) -> Array:
    """[C]: from the direction of motion where it is fast enough, from given headings elsewhere, held between."""
    controls, frame = len(position), 1 / max(clip_frames - 1, 1)
    count = max(int(np.ceil((s.t[-1] - s.t[0]) / frame - 1e-6)) + 1, 2)
    times = np.linspace(s.t[0], s.t[-1], count)
    velocity = design(times, controls, 1) @ position * frame
    along = velocity @ plane_axes(up).T
    speed = np.linalg.norm(along, axis=1)
    moving = speed > priors.least_speed
    angles, at = np.arctan2(along[:, 1], along[:, 0])[moving], times[moving]
    given = np.isfinite(s.heading)
    if not len(at):  # the way as a whole, or what was said of it
        along = (position[-1] - position[0]) @ plane_axes(up).T
        first = s.heading[given][:1] if given.any() else np.array([np.arctan2(along[1], along[0])])
        if not given.any():
            return np.full(controls, float(first[0]))
        angles, at = first, s.t[given][:1]
    at = np.concatenate([at, s.t[given]])
    angles = np.concatenate([angles, s.heading[given]])
    order = np.argsort(at, kind="stable")
    at, angles = at[order], unwrapped(angles[order])
    smooth = design(np.linspace(0, 1, clip_frames), controls, 2) * frame**2 / TURN_SD_RAD
    still = design(np.linspace(0, 1, clip_frames), controls, 1) * frame / DRIFT_SD_RAD
    rows, data = design(at, controls) / HEADING_SD_RAD, (angles - angles[0]) / HEADING_SD_RAD
    weights = np.ones(len(rows))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        system = np.concatenate([rows * root[:, None], smooth, still])
        target = np.concatenate([data * root, np.zeros(len(smooth) + len(still))])
        solution = np.linalg.lstsq(system, target, rcond=None)[0]
        weights = HUBER / np.maximum(np.abs(rows @ solution - data), HUBER)
    return np.asarray(solution + angles[0], np.float64)


def unwrapped(angles: Array) -> Array:
    """Headings without jumps: by whole turns, and by half a turn where a vehicle backs up."""
    result = np.array(angles, np.float64)
    half_turns = 0.0
    for i in range(1, len(result)):
        step = (angles[i] + half_turns - result[i - 1] + np.pi) % (2 * np.pi) - np.pi
        if abs(step) > REVERSAL_RAD:
            half_turns += np.pi
            step = (step + np.pi + np.pi) % (2 * np.pi) - np.pi
        result[i] = result[i - 1] + step
    return result

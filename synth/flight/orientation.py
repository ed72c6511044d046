"""Where a camera looks: rotations from angles, and look-at with an explicit up."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def orientation(yaw: float, pitch: float) -> Array:
    """Camera-to-world rotation [3, 3], OpenCV axes, level horizon; radians.

    Yaw turns counter-clockwise from east, pitch is 0 at the horizon and -pi/2 straight down. "Up" follows from the
    two angles, never from a cross product with the view direction: it is continuous through nadir and beyond.
    """
    forward = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])
    down = np.array([math.sin(pitch) * math.cos(yaw), math.sin(pitch) * math.sin(yaw), -math.cos(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    return np.stack([right, down, forward], axis=1)


def look_at(position: Array, target: Array, up_yaw: float | None) -> Array:
    """Camera-to-world rotation [3, 3] towards `target`; `up_yaw` (radians) is the heading that points up at nadir.

    Without one the horizon is level, which has no answer straight above the target: north is up there. With one the
    picture's right side is horizontal where the target lies straight ahead along `up_yaw`, also beyond nadir. It
    is singular only where the view runs along that heading on the horizon, which no camera that looks down does.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    if up_yaw is None:
        flat = float(np.hypot(forward[0], forward[1]))
        yaw = math.atan2(forward[1], forward[0]) if flat > 0 else math.pi / 2
        return orientation(yaw, math.atan2(forward[2], flat))
    # The cross product of the view with the heading, written out: it keeps its sign when the target passes below.
    right = np.cross(forward, [math.cos(up_yaw), math.sin(up_yaw), 0.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def pose(rotation: Array, position: Array) -> Array:
    """The matrix [4, 4] of a rotation and a position."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix

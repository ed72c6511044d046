"""The drone's flight: an exact float64 pose at any real time."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.spec import Flight

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


@dataclass(frozen=True)
class ArcFlight:
    """Constant altitude, radius and angular rate about a centre that the camera looks at.

    A radius of zero turns on the spot and looks straight down; the yaw still follows the arc's angle.
    """

    flight: Flight
    duration_s: float

    def camera_to_world(self, time_s: float) -> Array:
        """Pose [4, 4] at a real time, OpenCV axes."""
        flight = self.flight
        share = time_s / self.duration_s if self.duration_s > 0 else 0.0
        angle = math.radians(flight.start_deg + flight.sweep_deg * share)
        pose = np.eye(4)
        pitch = -math.atan2(flight.altitude_m - flight.centre_m[2], flight.radius_m)
        pose[:3, :3] = orientation(angle + math.pi, pitch)
        pose[0, 3] = flight.centre_m[0] + flight.radius_m * math.cos(angle)
        pose[1, 3] = flight.centre_m[1] + flight.radius_m * math.sin(angle)
        pose[2, 3] = flight.altitude_m
        return pose

    def viewmat(self, time_s: float) -> Array:
        """World to camera [4, 4]."""
        return invert_rigid(self.camera_to_world(time_s))

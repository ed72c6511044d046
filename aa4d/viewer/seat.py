"""One browser: how large its window is, and where its camera stands."""

from __future__ import annotations

import time
from dataclasses import dataclass

import viser

from aa4d.viewer.cameras import Eye
from aa4d.viewer.resolution import Size
from aa4d.viewer.riding import Ride

ARRIVAL_S = 2.0  # that a browser may take to go where it is sent


@dataclass
class Seat:
    """One browser."""

    client: viser.ClientHandle
    ride: Ride
    eye: Eye
    size: Size  # of its window, pixels
    # Where we put it `eye` is exact, and the browser's own camera, which has no roll, nearly the same.
    placed_at: float | None = None  # of a monotonic clock; None where a person has taken it elsewhere
    has_arrived: bool = False  # the browser has said that it is there

    def place(self, eye: Eye) -> None:
        self.eye, self.placed_at, self.has_arrived = eye, time.monotonic(), False

    def moved(self, eye: Eye, tolerance_m: float) -> None:
        """The browser says where it is: there, still on its way, or where a person took it."""
        if self.placed_at is not None:
            if abs(eye.fov - self.eye.fov) < 1e-4 and eye.is_seen_from(self.eye, tolerance_m):
                self.has_arrived = True
                return
            if not self.has_arrived and time.monotonic() - self.placed_at < ARRIVAL_S:
                return
        self.eye, self.placed_at = eye, None

    @property
    def aspect(self) -> float:
        return self.size[0] / self.size[1]

"""A camera that rides along the capture's way, and a person who takes it over."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from aa4d.capture.schema import Frame
from aa4d.viewer.cameras import Eye, fov_that_shows, pose_at
from aa4d.viewer.footage import nearest_frame
from aa4d.viewer.shown import Shown

REMEMBERED = 64  # poses, those of the seconds that a browser needs to say where it is


@dataclass
class Ride:
    """Poses along the way. A browser echoes those that it is sent; any other is a person's."""

    shown: Shown
    _sent: deque[Eye] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _last: tuple[tuple[float, float, bool], Eye] | None = None

    def eye(self, second: float, aspect: float, *, at_frames: bool) -> Eye:
        """At a second of the clip, in a window of `aspect`: the same object while nothing changes.

        Args:
            at_frames: stand where the nearest frame was taken.
        """
        key = (second, aspect, at_frames)
        if self._last is None or self._last[0] != key:
            loaded = self.shown.loaded
            t = self.shown.t_at(second)
            if at_frames:
                t = loaded.frames[nearest_frame(loaded.frames, t)].t
            self._last = key, Eye(pose_at(loaded.frames, t), fov_that_shows(loaded.camera, aspect))
        return self._last[1]

    def sent(self, eye: Eye) -> None:
        self._sent.append(eye)

    def is_echo(self, eye: Eye) -> bool:
        tolerance_m = 1e-3 * self.shown.loaded.frame.unit_m
        return any(eye.is_seen_from(other, tolerance_m) for other in self._sent)


def frame_after(frames: tuple[Frame, ...], second: float, steps: int) -> Frame:
    """The frame so many steps from the one nearest to a second, around the ends."""
    seconds = [abs(f.time_s - second) for f in frames]
    return frames[(seconds.index(min(seconds)) + steps) % len(frames)]

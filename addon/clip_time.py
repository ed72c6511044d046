"""Which instant of the clip a frame of the timeline shows: start, speed, reverse, hold, loop, or a time set by hand.

The same rule runs here, for live playback, and as nodes in `time_nodes`, for baked playback.
"""

import math
from dataclasses import dataclass

HOLD = "Hold"
LOOP = "Loop"
BOUNCE = "Back and Forth"
OUTSIDE = (HOLD, LOOP, BOUNCE)


@dataclass(frozen=True)
class ClipTime:
    """How the timeline maps to the clip."""

    frames: int  # of the clip
    start: float = 1.0  # frame of the timeline that shows the clip's first frame
    speed: float = 1.0  # clip frames a frame of the timeline
    by_hand: bool = False  # take `time` and leave the timeline alone
    time: float = 1.0  # frame of the clip, from 1
    outside: str = HOLD  # what comes before and after the clip
    reverse: bool = False

    def rank(self, frame: float) -> float:
        """The (fractional) rank of the clip's frame, 0 to frames - 1, that a frame of the timeline shows."""
        last = self.frames - 1
        rank = self.time - 1 if self.by_hand else (frame - self.start) * self.speed
        if not math.isfinite(rank):
            rank = 0.0
        if self.outside == LOOP:  # the last frame holds until the first comes: nothing lies between the two
            rank -= self.frames * math.floor(rank / self.frames)
        elif self.outside == BOUNCE and last:
            rank = last - abs(rank - 2 * last * math.floor(rank / (2 * last)) - last)
        rank = min(max(rank, 0.0), float(last))
        return last - rank if self.reverse else rank

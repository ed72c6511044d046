"""How many pixels to draw: a coarse picture at once while something moves, the whole one when all rests."""

from __future__ import annotations

from dataclasses import dataclass

MOVING_S = 0.04  # what a picture may take while something moves
REST_S = 0.08  # without any change, before a sharper picture is drawn
SHARP_S = 0.18  # what that one may take, so that it is there 0.3 s after the last change
COARSEST = 1 / 4  # of the window's sides
FORGET = 0.8  # what each picture leaves of the weight of those before it

Size = tuple[int, int]  # width, height


@dataclass(frozen=True)
class Cost:
    """Seconds of a picture as a line over its pixels, fitted to the pictures so far, the later ones more."""

    count: float = 0.0
    pixels: float = 0.0
    pixels_squared: float = 0.0
    seconds: float = 0.0
    product: float = 0.0

    def observed(self, pixels: int, seconds: float) -> Cost:
        p = pixels / 1e6
        before = (self.count, self.pixels, self.pixels_squared, self.seconds, self.product)
        return Cost(*(FORGET * old + new for old, new in zip(before, (1, p, p * p, seconds, p * seconds), strict=True)))

    def line(self) -> tuple[float, float]:
        """Seconds that every picture takes, and seconds a pixel; neither is negative.

        Pictures of one size do not tell the two apart: then all is put down to the pixels.
        """
        if not self.count:
            return 0.0, 0.0
        spread = self.count * self.pixels_squared - self.pixels**2
        through_origin = self.product / self.pixels_squared / 1e6
        if spread < 1e-3 * self.pixels**2:
            return 0.0, through_origin
        slope = (self.count * self.product - self.pixels * self.seconds) / spread
        fixed = (self.seconds - slope * self.pixels) / self.count
        if slope <= 0:
            return self.seconds / self.count, 0.0
        return (fixed, slope / 1e6) if fixed > 0 else (0.0, through_origin)


def size_within(seconds: float, cost: Cost, full: Size) -> Size:
    """The largest size that is expected to be drawn in time, between `COARSEST` of `full` and `full`.

    Where most of the time goes to what no resolution changes, fewer pixels than take half of that save nothing.
    """
    fixed, each = cost.line()
    pixels = full[0] * full[1]
    allowed = max(seconds - fixed, fixed / 2)
    if each * pixels <= allowed:
        return full
    share = max((allowed / (each * pixels)) ** 0.5, COARSEST)
    return max(round(full[0] * share), 1), max(round(full[1] * share), 1)


def next_size(drawn: Size | None, rested_s: float, cost: Cost, full: Size) -> tuple[Size, float] | None:
    """What to draw next of a view, and in how many seconds; None when nothing is left to do.

    Args:
        drawn: the size of the last picture of just this view, None where there is none yet.
        rested_s: since the view last changed.
    """
    if drawn is None:
        return size_within(MOVING_S, cost, full), 0.0
    if drawn == full:
        return None
    sharp = size_within(SHARP_S, cost, full)
    return (sharp if sharp[0] > drawn[0] else full), max(REST_S - rested_s, 0.0)

"""The networks that see only an embedding and the time: known at knots of time, and mixed between them. No bpy here.

Half of what a frame costs is theirs, and what they say changes slowly. So while the timeline plays, a frame takes the
mean of the two knots around it, which are computed once; a frame that stands is exact.
"""

from dataclasses import dataclass, field

import numpy as np

from .container import Floats
from .field import PLANES, Field, TimeNetwork
from .products import over_chunks

# Between the first and the last frame, of a clip that is long enough: docs/addon.md says what that costs in accuracy. A
# knot costs more than it saves where fewer frames share it.
MOST_INTERVALS, FEWEST_INTERVALS, FRAMES_A_KNOT = 16, 6, 6
KEPT = 3  # knots of each network: playback goes forwards or backwards


@dataclass(frozen=True)
class Mixed:
    """The networks at one time, from the knots on either side."""

    fraction: np.float32
    shares: tuple[Floats, Floats] | None  # [6, N, C] of ACFA; None where the network is to be asked itself
    offset: tuple[Floats, Floats] | None  # [N, 3 K]
    scale: tuple[Floats, Floats] | None  # [N, 6]

    def shares_of(self, part: slice) -> Floats | None:
        """The share of each plane [6, n, C] for a slice of the anchors."""
        return None if self.shares is None else self._mix(*(knot[:, part] for knot in self.shares))

    def offset_of(self, part: slice) -> Floats | None:
        """Phi_o [n, 3 K]."""
        return None if self.offset is None else self._mix(*(knot[part] for knot in self.offset))

    def scale_of(self, part: slice) -> Floats | None:
        """Phi_s [n, 6]."""
        return None if self.scale is None else self._mix(*(knot[part] for knot in self.scale))

    def _mix(self, low: Floats, high: Floats) -> Floats:
        mixed = high - low
        mixed *= self.fraction
        mixed += low
        return mixed


@dataclass(frozen=True)
class Knots:
    """The knots of a model, as far as they were needed."""

    intervals: int
    known: dict[tuple[str, int], Floats] = field(default_factory=dict)

    def at(self, model: Field, t: float, *, offsets: bool) -> Mixed:
        """The networks at t; those of the offsets only where they are needed."""
        place = min(max(t, 0.0), 1.0) * self.intervals
        low = min(int(place), self.intervals - 1)
        return Mixed(
            np.float32(place - low),
            self._around("shares", model.weights, low, model.model.anchor_count),
            self._around("offset", model.offset if offsets else None, low, model.model.anchor_count),
            self._around("scale", model.scale, low, model.model.anchor_count),
        )

    def _around(self, name: str, network: TimeNetwork | None, low: int, count: int) -> tuple[Floats, Floats] | None:
        """The knots on either side; None where there is no network, or one that all anchors share, which is cheap."""
        if network is None or len(network.static) < count:
            return None
        for knot in (low, low + 1):
            if (name, knot) not in self.known:
                mine = [key for key in self.known if key[0] == name]
                for key in mine[: max(0, len(mine) + 1 - KEPT)]:
                    del self.known[key]
                self.known[name, knot] = _evaluated(network, knot / self.intervals, count, shares=name == "shares")
        return self.known[name, low], self.known[name, low + 1]


def of_clip(frames: int) -> Knots | None:
    """Knots for a clip of so many frames; None where every frame is to be evaluated."""
    intervals = min(frames // FRAMES_A_KNOT, MOST_INTERVALS)
    return Knots(intervals) if intervals >= FEWEST_INTERVALS else None


def _evaluated(network: TimeNetwork, t: float, count: int, *, shares: bool) -> Floats:
    """The outputs [N, outputs] of a network, or the shares of the planes [6, N, C] that they stand for."""
    parts = over_chunks(count, lambda part: _shares(network(t, part)) if shares else network(t, part))
    return np.concatenate(parts, axis=1 if shares else 0)


def _shares(scores: Floats) -> Floats:
    shares = scores.reshape(len(scores), len(PLANES), -1).transpose(1, 0, 2).copy()
    shares -= shares.max(axis=0)
    np.exp(shares, out=shares)
    shares /= shares.sum(axis=0)
    return shares

"""Everything in a scene that has an id: the vehicles, and what effects add. The one source of ids, poses and speeds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.staging import Extras
from synth.traffic.fleet import BODIES
from synth.traffic.instances import MOVING_MPS, Fleet

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Member:
    """An instance. Ids count from 1; 0 is the background."""

    id: int
    name: str
    class_name: str
    dimensions_m: tuple[float, float, float]


@dataclass(frozen=True)
class Cast:
    """Vehicles first, then the extras in the order of their effects; arrays over the M members keep this order."""

    fleet: Fleet
    extras: tuple[Extras, ...] = ()

    def members(self) -> tuple[Member, ...]:
        found: list[tuple[str, str, tuple[float, float, float]]] = [
            (instance.name, BODIES[instance.kind].label, BODIES[instance.kind].dimensions_m)
            for instance in self.fleet.instances
        ]
        for extra in self.extras:
            sizes = [(float(length), float(width), float(height)) for length, width, height in extra.dimensions_m]
            found += list(zip(extra.names, extra.classes, sizes, strict=True))
        return tuple(Member(number, *what) for number, what in enumerate(found, start=1))

    def object_to_world(self, time_s: float) -> Array:
        """Rigid poses [M, 4, 4]."""
        return np.concatenate([self.fleet.object_to_world(time_s), *(e.object_to_world(time_s) for e in self.extras)])

    def speed_mps(self, time_s: float) -> Array:
        """Speeds [M]."""
        return np.concatenate([self.fleet.speed_mps(time_s), *(e.speed_mps(time_s) for e in self.extras)])

    def moving(self, time_s: float) -> Mask:
        """Which members move [M]."""
        return self.speed_mps(time_s) > MOVING_MPS

    def present(self, time_s: float) -> Mask:
        """Which members are in the scene [M]."""
        here = [self.fleet.present(time_s)]
        here += [np.ones(len(e.names), dtype=bool) if e.present is None else e.present(time_s) for e in self.extras]
        return np.concatenate(here)

    def lit(self, time_s: float) -> Mask:
        """Which members shine [M]; those that never do are False."""
        parts = [np.zeros(len(self.fleet.instances), dtype=bool)]
        parts += [np.zeros(len(e.names), dtype=bool) if e.lit is None else e.lit(time_s) for e in self.extras]
        return np.concatenate(parts)

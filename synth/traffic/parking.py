"""Vehicles parked along the kerbs: bays on both sides of every arm, filled at random."""

from dataclasses import dataclass

import numpy as np

from synth.spec import Kind, Street
from synth.traffic.fleet import BODIES
from synth.traffic.network import ARMS, stop_distance

BAY_M = 6.0
CLEAR_OF_STOP_LINE_M = 4.0
CLEAR_OF_KERB_M = 0.2
KINDS: tuple[tuple[Kind, float], ...] = (("hatchback", 0.40), ("saloon", 0.28), ("suv", 0.22), ("van", 0.10))


@dataclass(frozen=True)
class Parked:
    """A vehicle that stands through the clip."""

    kind: Kind
    centre: tuple[float, float]
    heading: float  # radians


def park(street: Street, share: float, rng: np.random.Generator) -> tuple[Parked, ...]:
    """Fill each bay with probability `share`, in the direction of traffic on that side of the street."""
    kinds, weights = [kind for kind, _ in KINDS], [weight for _, weight in KINDS]
    parked = []
    for dx, dy in ARMS.values():
        for side in (1, -1):  # 1: right of someone who leaves the crossing
            first = stop_distance(street) + CLEAR_OF_STOP_LINE_M + 0.5 * BAY_M
            for along in np.arange(first, street.arm_m, BAY_M):
                taken, kind = rng.random() < share, kinds[rng.choice(len(kinds), p=weights)]
                shift, twist = rng.uniform(-0.3, 0.3), rng.normal(0, 0.015)
                if not taken:
                    continue
                across = street.lane_width_m + street.parking_width_m - CLEAR_OF_KERB_M - 0.5 * BODIES[kind].width_m
                x = dx * (along + shift) + side * dy * across
                y = dy * (along + shift) - side * dx * across
                parked.append(Parked(kind, (float(x), float(y)), float(np.arctan2(side * dy, side * dx) + twist)))
    return tuple(parked)

"""The lanes of a street layout: approaches, connectors through the junction, exits; and the routes along them.

Traffic keeps to the right. Every approach ends at its stop line.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from synth.spec import Street
from synth.traffic.paths import Path, Piece, line

ARMS = {"east": (1.0, 0.0), "north": (0.0, 1.0), "west": (-1.0, 0.0), "south": (0.0, -1.0)}
CROSSING_WIDTH_M = 2.6  # zebra crossing
CROSSING_SETBACK_M = 0.6  # from the end of the kerb's curve to the zebra crossing
STOP_SETBACK_M = 1.0  # from the zebra crossing to the stop line


@dataclass(frozen=True)
class Network:
    """Lanes by name, and for each route "from-to" the names of its approach, connector and exit."""

    lanes: dict[str, Path]
    routes: dict[str, tuple[str, str, str]]

    def route_path(self, route: str) -> Path:
        return Path(tuple(piece for name in self.routes[route] for piece in self.lanes[name].pieces))

    def stop_line_m(self, route: str) -> float:
        """Arc length of the stop line along the route."""
        return self.lanes[self.routes[route][0]].length_m


def half_width(street: Street) -> float:
    """From the middle of the carriageway to the kerb, metres."""
    return street.lane_width_m + street.parking_width_m


def junction_radius(street: Street) -> float:
    """From the centre of the crossing to where the kerbs are straight again, metres."""
    return half_width(street) + street.corner_radius_m


def stop_distance(street: Street) -> float:
    """From the centre of the crossing to the stop lines, metres."""
    return junction_radius(street) + CROSSING_SETBACK_M + CROSSING_WIDTH_M + STOP_SETBACK_M


def crossroads(street: Street) -> Network:
    """Four arms, one lane each way, all twelve movements."""
    offset = 0.5 * street.lane_width_m
    stop, edge = stop_distance(street), junction_radius(street)
    lanes: dict[str, Path] = {}
    routes: dict[str, tuple[str, str, str]] = {}

    def inbound(arm: str, distance: float) -> tuple[float, float]:
        dx, dy = ARMS[arm]
        return dx * distance - dy * offset, dy * distance + dx * offset

    def outbound(arm: str, distance: float) -> tuple[float, float]:
        dx, dy = ARMS[arm]
        return dx * distance + dy * offset, dy * distance - dx * offset

    for arm in ARMS:
        lanes[f"{arm}-in"] = Path((line(inbound(arm, street.arm_m), inbound(arm, stop)),))
        lanes[f"{arm}-out"] = Path((line(outbound(arm, stop), outbound(arm, street.arm_m)),))
    for source, (sx, sy) in ARMS.items():
        for target, (tx, ty) in ARMS.items():
            if source == target:
                continue
            turn = sx * -ty - sy * -tx  # sine of the angle from travel direction -s to t: 1 left, -1 right, 0 straight
            start, end = inbound(source, stop), outbound(target, stop)
            if turn == 0:
                pieces: tuple[Piece, ...] = (line(start, end),)
            else:
                # Tangent to both lanes; the inner kerb's centre for right turns.
                radius = edge - offset if turn < 0 else edge
                reach = radius + turn * -offset  # from the arc's ends to the centre line of the crossing street
                first = line(start, inbound(source, reach))
                arc = Piece(first.end, first.heading, turn / radius, 0.5 * math.pi * radius)
                pieces = (first, arc, line(arc.end, end))
            lanes[f"{source}-{target}"] = Path(pieces)
            routes[f"{source}-{target}"] = (f"{source}-in", f"{source}-{target}", f"{target}-out")
    return Network(lanes, routes)


def joints(path: Path) -> np.ndarray:
    """Gaps between successive pieces: [pieces - 1, 2] of metres and radians (wrapped). All zero for a sound path."""
    gaps = []
    for before, after in itertools.pairwise(path.pieces):
        turn = math.remainder(after.heading - before.end_heading, 2 * math.pi)
        gaps.append((math.dist(before.end, after.start), turn))
    return np.array(gaps).reshape(-1, 2)

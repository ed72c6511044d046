"""Roundabout: four streets around an island, counter-clockwise; who is on the ring goes first."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from synth.checking import key
from synth.city.mesh import circle
from synth.streets.arms import (
    CROSSING_SETBACK_M,
    CROSSING_WIDTH_M,
    DIRECTIONS,
    STOP_SETBACK_M,
    Arm,
    approach_lanes,
    arc,
    arm_bays,
    arm_walks,
    bend_limit,
    entries,
)
from synth.streets.ground import (
    BEYOND_M,
    KERB_M,
    Ground,
    Island,
    Paint,
    Row,
    arm_paint,
    arm_rows,
    zebra_paint,
)
from synth.streets.keys import ParkingStrip, Sizes
from synth.traffic.network import KERB_HEIGHT_M, Crossing, Lane, Network
from synth.traffic.paths import Path, Piece, Point, line

FLARE_M = 14.0  # radius of the kerbs and paths between an arm and the ring
RING_WIDTH_M = 6.5


@dataclass(frozen=True, kw_only=True)
class Roundabout(ParkingStrip, Sizes):
    """Four streets that meet at a ring around a planted island. Traffic on the ring has the right of way; `[signal]`
    has no effect here and is refused."""

    kind: Literal["roundabout"] = "roundabout"
    ring_radius_m: float = key("radius of the middle of the ring's lane", unit="m", range=(11, 40), default=15.0)

    def _arms(self) -> dict[str, Arm]:
        return {
            name: Arm(name, self.arm_m, self.lane_width_m, 1, 0.0, 0.0, self.parking_width_m) for name in DIRECTIONS
        }

    @property
    def _outer_m(self) -> float:
        return self.ring_radius_m + 0.5 * RING_WIDTH_M

    def _kerb_end(self, half: float) -> float:
        """How far out the kerbs of the arms are straight again."""
        return math.sqrt((self._outer_m + FLARE_M) ** 2 - (half + FLARE_M) ** 2)

    def _stop(self, half: float) -> float:
        return self._kerb_end(half) + CROSSING_SETBACK_M + CROSSING_WIDTH_M + STOP_SETBACK_M

    def network(self, signals: bool) -> Network:  # noqa: ARG002 - refused with the scene
        arms = self._arms()
        half = arms["east"].half_width_m
        stop, offset, ring = self._stop(half), arms["east"].offset(0), self.ring_radius_m
        lanes: dict[str, Lane] = {}
        # Of an arm that points south: where the path from it touches the ring, as an angle.
        touch = math.atan2(-math.sqrt((ring + FLARE_M) ** 2 - (offset + FLARE_M) ** 2), offset + FLARE_M)
        spread = touch + 0.5 * math.pi
        order = list(DIRECTIONS)
        for name, arm in arms.items():
            lanes |= approach_lanes(arm, stop)
            entry, leave = self._entry(arm, stop, touch), self._exit(arm, stop, touch)
            lanes[f"{name}-entry"] = Lane(entry, True, 1, limit_mps=bend_limit(entry))
            lanes[f"{name}-exit"] = Lane(leave, True, 5, limit_mps=bend_limit(leave))
            pass_by = Path((arc((0.0, 0.0), ring, arm.angle - spread, 2 * spread),))
            lanes[f"{name}-pass"] = Lane(pass_by, True, 5, limit_mps=bend_limit(pass_by))
            between = Path((arc((0.0, 0.0), ring, arm.angle + spread, 0.5 * math.pi - 2 * spread),))
            lanes[f"{name}-between"] = Lane(between, limit_mps=bend_limit(between))
        routes = {}
        for i, source in enumerate(order):
            for turns in (1, 2, 3):
                around = [f"{order[(i + n) % 4]}-{what}" for n in range(1, turns) for what in ("pass", "between")]
                target = order[(i + turns) % 4]
                routes[f"{source}-{target}/0"] = (f"{source}-in/0", f"{source}-entry", f"{source}-between", *around,
                                                  f"{target}-exit", f"{target}-out/0")  # fmt: skip
        along = self._kerb_end(half) + CROSSING_SETBACK_M + 0.5 * CROSSING_WIDTH_M
        crossings = tuple(Crossing(arm.place(along, -half), arm.place(along, half), CROSSING_WIDTH_M)
                          for arm in arms.values())  # fmt: skip
        bays = tuple(bay for arm in arms.values() for bay in arm_bays(arm, stop))
        walks = tuple(path for arm in arms.values() for path in arm_walks(arm, stop))
        return Network(lanes, routes, crossings, bays, walks, entries(routes))

    def _entry(self, arm: Arm, stop: float, touch: float) -> Path:
        """Straight towards the ring, then a bend to the right that touches it."""
        turn = arm.angle + 0.5 * math.pi  # from an arm that points south
        flare = _rotated((arm.offset(0) + FLARE_M, (self.ring_radius_m + FLARE_M) * math.sin(touch)), turn)
        bend = arc(flare, FLARE_M, turn + math.pi, touch)
        return Path((line(arm.inbound(0, stop), bend.start), bend))

    def _exit(self, arm: Arm, stop: float, touch: float) -> Path:
        turn = arm.angle + 0.5 * math.pi
        flare = _rotated((-arm.offset(0) - FLARE_M, (self.ring_radius_m + FLARE_M) * math.sin(touch)), turn)
        bend = arc(flare, FLARE_M, turn - touch, touch)
        return Path((bend, line(bend.end, arm.outbound(0, stop))))

    def ground(self, signals: bool) -> Ground:  # noqa: ARG002
        arms = self._arms()
        half = arms["east"].half_width_m
        stop = self._stop(half)
        islands = [Island(Path((arc((0.0, 0.0), self.ring_radius_m - 0.5 * RING_WIDTH_M, 0.0, 2 * math.pi),)),
                          surface="grass")]  # fmt: skip
        behind = self._outer_m * math.sqrt(0.5) + KERB_M + self.pavement_width_m + 1.0
        plots = {}
        for corner, angle in (("north-east", 0.0), ("north-west", 0.5 * math.pi), ("south-west", math.pi),
                              ("south-east", -0.5 * math.pi)):  # fmt: skip
            far = _rotated((BEYOND_M, BEYOND_M), angle)
            islands.append(Island(self._corner_kerb(half, angle), (far,), (corner,), pavement_m=self.pavement_width_m))
            plots[corner] = (math.copysign(behind, far[0]), math.copysign(behind, far[1]))
        paint: list[Paint] = []
        rows: list[Row] = []
        for arm in arms.values():
            paint += arm_paint(arm, stop) + zebra_paint(arm, self._kerb_end(half))
            rows += arm_rows(arm, stop + 3.0)
        ring = self.ring_radius_m
        bed = circle(0.45 * (ring - 0.5 * RING_WIDTH_M), 32)
        paint.append(Paint(tuple(bed), "flowers", KERB_HEIGHT_M))
        for angle in np.arange(0, 2 * math.pi, math.radians(12)):
            dash = arc((0.0, 0.0), ring + 0.5 * RING_WIDTH_M - 0.25, float(angle), math.radians(5))
            inner = dash.inset(0.12)
            paint.append(Paint((dash.start, dash.end, inner.end, inner.start)))
        worn = ((Path((arc((0.0, 0.0), ring, 0.0, 2 * math.pi),)), 0.0),)
        return Ground(tuple(islands), tuple(paint), plots, tuple(rows), (), worn)

    def _corner_kerb(self, half: float, turn: float) -> Path:
        """Of the north-eastern corner, turned: in from the north, around the ring's outside, out to the east."""
        reach, outer = self._kerb_end(half), self._outer_m
        end = math.atan2(half + FLARE_M, reach)  # of the flare's centre, from the arm's axis
        flare = math.acos((half + FLARE_M) / (outer + FLARE_M))
        first = line((half, BEYOND_M), (half, reach))
        into = arc((half + FLARE_M, reach), FLARE_M, math.pi, flare)
        ring = arc((0.0, 0.0), outer, 0.5 * math.pi - end, -(0.5 * math.pi - 2 * end))
        out = arc((reach, half + FLARE_M), FLARE_M, 1.5 * math.pi - flare, flare)
        pieces = (first, into, ring, out, line(out.end, (BEYOND_M, half)))
        return Path(tuple(Piece(_rotated(p.start, turn), p.heading + turn, p.curvature, p.length_m) for p in pieces))


def _rotated(point: Point, angle: float) -> Point:
    cos, sin = math.cos(angle), math.sin(angle)
    return point[0] * cos - point[1] * sin, point[0] * sin + point[1] * cos

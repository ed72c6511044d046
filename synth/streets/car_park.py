"""Car park: rows of bays behind a street, with vehicles that come in, park, and drive out."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from synth.checking import key
from synth.streets.arms import Arm, Junction, bend_limit, entries, junction, lane_name, network
from synth.streets.ground import BEYOND_M, Ground, Island, Paint, arm_paint, arm_rows, junction_ground
from synth.streets.keys import Corners, CycleLanes, Sizes
from synth.traffic.network import Bay, Lane, Network
from synth.traffic.paths import Path, Point, line, rounded

AISLE_M = 7.0
BAY_LENGTH_M, BAY_WIDTH_M = 5.2, 2.7
STRIP_M = 8.0  # pavement and hedge between the street and the bays
KEEP_M = 1.7  # from the middle of an aisle to where one drives
TURN_M = 4.6


@dataclass(frozen=True, kw_only=True)
class CarPark(Corners, CycleLanes, Sizes):
    """A street from west to east, and north of it a car park: `parked_share` of its bays are taken. Vehicles that
    arrive and leave (`[parking]`) use it, not the kerbs."""

    kind: Literal["car-park"] = "car-park"
    columns: int = key("aisles with bays on both sides", range=(1, 5), default=3)
    rows: int = key("bays along each side of an aisle", range=(4, 40), default=14)

    def _shape(self, signals: bool) -> Junction:
        arms = [Arm(name, self.arm_m, self.lane_width_m, 1, 0.0, self.cycle_width_m, 0.0) for name in ("east", "west")]
        arms.append(Arm("north", self._gate_m, self.lane_width_m))
        return junction(arms, self.corner_radius_m, major=("east", "west"), crossings=False, signals=signals)

    @property
    def _street_half(self) -> float:
        return self.lane_width_m + self.cycle_width_m

    @property
    def _gate_m(self) -> float:
        """Where the way in meets the aisle across."""
        return self._street_half + STRIP_M

    @property
    def _first_m(self) -> float:
        """y of the first bays' near edge."""
        return self._gate_m + AISLE_M

    @property
    def _far_m(self) -> float:
        return self._first_m + self.rows * BAY_WIDTH_M + 2.0

    def _aisles(self) -> list[float]:
        spacing = AISLE_M + 2 * BAY_LENGTH_M
        return [(i - 0.5 * (self.columns - 1)) * spacing for i in range(self.columns)]

    @property
    def _half_m(self) -> float:
        return 0.5 * self.columns * (AISLE_M + 2 * BAY_LENGTH_M) + 1.0

    def _bays(self) -> list[tuple[float, int, Point]]:
        """All bays: x of their aisle, side of it (1: east), and middle."""
        return [
            (x, side, (x + side * 0.5 * (AISLE_M + BAY_LENGTH_M), self._first_m + (row + 0.5) * BAY_WIDTH_M))
            for x in self._aisles()
            for side in (-1, 1)
            for row in range(self.rows)
        ]

    def network(self, signals: bool) -> Network:
        shape = self._shape(signals)
        street = network(shape)
        stem = shape.arms["north"]
        lanes, routes, bays = dict(street.lanes), dict(street.routes), []
        for number, (x, side, middle) in enumerate(self._bays()):
            heading = 0.0 if side > 0 else math.pi
            # Who came last week stands nose in or backed in; who leaves is backed in, who comes goes in nose first.
            bays.append(Bay("", 0.0, 0.0, (*middle, heading + (math.pi if number % 3 else 0.0))))
            if number % 4 != 1:
                continue  # a way to every fourth bay is enough to choose from
            mouth = (x + side * 0.5 * AISLE_M, middle[1])
            deep = (x + side * (0.5 * AISLE_M + BAY_LENGTH_M), middle[1])
            y_in, y_out = self._gate_m + 0.5 * AISLE_M - KEEP_M, self._gate_m + 0.5 * AISLE_M + KEEP_M
            # On the right of the aisle across and of the aisle along.
            if abs(x) < 1:
                come = rounded([stem.outbound(0, self._gate_m), (stem.outbound(0, 0)[0], mouth[1]), mouth], TURN_M)
                go = rounded([mouth, (stem.inbound(0, 0)[0], mouth[1]), stem.inbound(0, self._gate_m)], TURN_M)
            else:
                across_in = y_in if x > 0 else y_out
                across_out = y_out if x > 0 else y_in
                up, down = x + KEEP_M, x - KEEP_M
                come = rounded([stem.outbound(0, self._gate_m), (stem.outbound(0, 0)[0], across_in), (up, across_in),
                                (up, mouth[1]), mouth], TURN_M)  # fmt: skip
                go = rounded([mouth, (down, mouth[1]), (down, across_out), (stem.inbound(0, 0)[0], across_out),
                              stem.inbound(0, self._gate_m)], TURN_M)  # fmt: skip
            lanes[f"come-{number}"] = Lane(come, True, 2, limit_mps=min(4.0, bend_limit(come)))
            lanes[f"go-{number}"] = Lane(go, True, 1, limit_mps=min(4.0, bend_limit(go)))
            lanes[f"bay-{number}-in"] = Lane(Path((line(mouth, deep),)), limit_mps=2.0)
            lanes[f"bay-{number}-out"] = Lane(Path((line(deep, mouth),)), limit_mps=2.0)
            for side_name in ("east", "west"):
                arm = shape.arms[side_name]
                routes[f"{side_name}-lot{number}/0"] = (
                    lane_name(arm, 0, "in"), f"{side_name}-north/0", lane_name(stem, 0, "out"), f"come-{number}",
                    f"bay-{number}-in",
                )  # fmt: skip
                routes[f"lot{number}-{side_name}/0"] = (
                    f"bay-{number}-out", f"go-{number}", lane_name(stem, 0, "in"), f"north-{side_name}/0",
                    lane_name(arm, 0, "out"),
                )  # fmt: skip
        for name in [name for name in routes if "north" in name.split("/")[0]]:
            del routes[name]  # the way in leads to bays only
        through = {name: names for name, names in routes.items() if "lot" not in name}
        walks = [path for path in street.walks if abs(path.pieces[0].start[0]) > 8]
        return Network(lanes, routes, (), tuple(bays), tuple(walks), entries(through))

    def ground(self, signals: bool) -> Ground:
        shape = self._shape(signals)
        ground = junction_ground(shape, self.pavement_width_m)
        half, stem = self._street_half, shape.arms["north"].half_width_m
        inside, far, wide = self._gate_m, self._far_m, self._half_m
        corners = [(-BEYOND_M, half), (-stem, half), (-stem, inside), (-wide, inside), (-wide, far), (wide, far),
                   (wide, inside), (stem, inside), (stem, half), (BEYOND_M, half)]  # fmt: skip
        radii = [0, self.corner_radius_m, 2.0, 1.0, 1.0, 1.0, 1.0, 2.0, self.corner_radius_m, 0]
        north = Island(rounded(corners, radii), ((BEYOND_M, BEYOND_M), (-BEYOND_M, BEYOND_M)), ("north-east",),
                       pavement_m=self.pavement_width_m)  # fmt: skip
        south = next(island for island in ground.islands if island.corners[0].startswith("south"))
        paint = [p for name in ("east", "west") for p in arm_paint(shape.arms[name], 2.0, stop_line=False)]
        for x, side, (_, y) in self._bays():
            inner, outer = x + side * 0.5 * AISLE_M, x + side * (0.5 * AISLE_M + BAY_LENGTH_M)
            for edge in (y - 0.5 * BAY_WIDTH_M, y + 0.5 * BAY_WIDTH_M):
                paint.append(Paint(((inner, edge - 0.05), (outer, edge - 0.05), (outer, edge + 0.05),
                                    (inner, edge + 0.05))))  # fmt: skip
        rows = [row for name in ("east", "west") for row in arm_rows(shape.arms[name], stem + 8.0)]
        plots = dict(ground.plots) | {"north-east": (1.0, far + 4.5), "north-west": (-1.0, far + 4.5)}
        return replace(ground, islands=(north, south), paint=tuple(paint), plots=plots, rows=tuple(rows))

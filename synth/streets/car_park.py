"""Car park: rows of bays behind a street, with vehicles that come in, park, and drive out."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from synth.checking import key
from synth.streets.arms import Arm, Junction, entries, junction, lane_name, network
from synth.streets.ground import BEYOND_M, Ground, Island, Paint, Row, arm_paint, arm_rows, junction_ground
from synth.streets.keys import Corners, CycleLanes, Sizes
from synth.traffic.network import Bay, Lane, Network
from synth.traffic.paths import Path, Point, line, rounded

AISLE_M = 7.0
BAY_LENGTH_M, BAY_WIDTH_M = 5.2, 2.7
STRIP_M = 8.0  # pavement and hedge between the street and the bays
KEEP_M = 1.7  # from the middle of an aisle to where one drives
TURN_M = 4.6
SLOW_MPS = 4.0
HEAD_M = 1.6  # between the aisle across and the first bays: room to swing out


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
        return self._gate_m + AISLE_M + HEAD_M

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
            if number % 2:
                continue  # a way to every other bay is enough to choose from
            # Left turns have room: who comes up the right side of an aisle parks on its left, who goes down likewise.
            if side < 0:
                lanes |= self._way_in(number, x, middle[1], stem)
            else:
                lanes |= self._way_out(number, x, middle[1], stem)
            for side_name in ("east", "west"):
                arm = shape.arms[side_name]
                if side < 0:
                    routes[f"{side_name}-lot{number}/0"] = (
                        lane_name(arm, 0, "in"), f"{side_name}-north/0", lane_name(stem, 0, "out"), f"come-{number}",
                        f"bay-{number}",
                    )  # fmt: skip
                else:
                    routes[f"lot{number}-{side_name}/0"] = (
                        f"bay-{number}", f"go-{number}", lane_name(stem, 0, "in"), f"north-{side_name}/0",
                        lane_name(arm, 0, "out"),
                    )  # fmt: skip
        for name in [name for name in routes if "north" in name.split("/")[0]]:
            del routes[name]  # the way in leads to bays only
        through = {name: names for name, names in routes.items() if "lot" not in name}
        walks = [path for path in street.walks if abs(path.pieces[0].start[0]) > 8]
        return Network(lanes, routes, (), tuple(bays), tuple(walks), entries(through))

    def _way_in(self, number: int, x: float, y: float, stem: Arm) -> dict[str, Lane]:
        """From the gate into a bay west of the aisle at x, nose first."""
        mouth, gate = (x - 0.5 * AISLE_M, y), stem.outbound(0, self._gate_m)
        along = [(gate[0], y)] if abs(x) < 1 else [(gate[0], self._across(x > 0)), (x + KEEP_M, self._across(x > 0)),
                                                   (x + KEEP_M, y)]  # fmt: skip
        come = rounded([gate, *along, mouth], TURN_M)
        bay = Path((line(mouth, (mouth[0] - BAY_LENGTH_M, y)),))
        return {f"come-{number}": Lane(come, True, 2, limit_mps=SLOW_MPS), f"bay-{number}": Lane(bay, limit_mps=2.0)}

    def _way_out(self, number: int, x: float, y: float, stem: Arm) -> dict[str, Lane]:
        """From a bay east of the aisle at x, in which the vehicle stands backed in, to the gate."""
        mouth, gate = (x + 0.5 * AISLE_M, y), stem.inbound(0, self._gate_m)
        along = [(gate[0], y)] if abs(x) < 1 else [(x - KEEP_M, y), (x - KEEP_M, self._across(x < 0)),
                                                   (gate[0], self._across(x < 0))]  # fmt: skip
        go = rounded([mouth, *along, gate], TURN_M)
        bay = Path((line((mouth[0] + BAY_LENGTH_M, y), mouth),))
        return {f"go-{number}": Lane(go, True, 1, limit_mps=SLOW_MPS), f"bay-{number}": Lane(bay, limit_mps=2.0)}

    def _across(self, eastwards: bool) -> float:
        """y of the lane along the street-side aisle: traffic keeps to the right."""
        return self._gate_m + 0.5 * AISLE_M + (-KEEP_M if eastwards else KEEP_M)

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
        rows += [Row((-wide, inside), (-wide, far)), Row((-wide, far), (wide, far)), Row((wide, far), (wide, inside))]
        beside, behind = wide + 6.0, half + self.pavement_width_m + 1.0
        plots = dict(ground.plots) | {"north-east": (beside, behind), "north-west": (-beside, behind)}
        return replace(ground, islands=(north, south), paint=tuple(paint), plots=plots, rows=tuple(rows))

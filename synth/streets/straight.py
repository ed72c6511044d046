"""Straight street: one road, with a zebra crossing half way."""

from dataclasses import dataclass, replace
from typing import Literal

from synth.checking import key
from synth.streets.arms import CROSSING_SETBACK_M, CROSSING_WIDTH_M, STOP_SETBACK_M, Arm, Junction, network
from synth.streets.ground import Ground, junction_ground, zebra_paint
from synth.streets.keys import CycleLanes, ParkingStrip, Sizes
from synth.traffic.network import Crossing, Network


@dataclass(frozen=True, kw_only=True)
class Straight(CycleLanes, ParkingStrip, Sizes):
    """A road from west to east through the origin, with a zebra crossing there. `[signal]` puts lights at it, those
    of east and west."""

    kind: Literal["straight"] = "straight"
    lanes: int = key("lanes each way", range=(1, 4), default=1)
    crossing: bool = key("a zebra crossing at the origin", default=True)

    def _shape(self, signals: bool) -> Junction:
        stop = 0.5 * CROSSING_WIDTH_M + STOP_SETBACK_M
        widths = (self.lanes, 0.0, self.cycle_width_m, self.parking_width_m)
        arms = {name: Arm(name, self.arm_m, self.lane_width_m, *widths) for name in ("east", "west")}
        stops, edges = dict.fromkeys(arms, stop), dict.fromkeys(arms, 0.5 * CROSSING_WIDTH_M)
        return Junction(arms, stops, edges, 0.0, frozenset(arms), False, signals)

    def network(self, signals: bool) -> Network:
        made = network(self._shape(signals))
        half = self._shape(signals).arms["east"].half_width_m
        gate = "east_west" if signals else None
        crossings = (Crossing((0.0, -half), (0.0, half), CROSSING_WIDTH_M, gate),) if self.crossing else ()
        return replace(made, crossings=crossings)

    def ground(self, signals: bool) -> Ground:
        shape = self._shape(signals)
        ground = junction_ground(shape, self.pavement_width_m, stop_lines=self.crossing)
        if not self.crossing:
            return ground
        zebra = zebra_paint(shape.arms["east"], -0.5 * CROSSING_WIDTH_M - CROSSING_SETBACK_M)
        return replace(ground, paint=(*ground.paint, *zebra))

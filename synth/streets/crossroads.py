"""Crossroads: two streets that cross at the origin."""

from dataclasses import dataclass
from typing import Literal

from synth.checking import key
from synth.streets.arms import DIRECTIONS, Arm, Junction, junction, network
from synth.streets.ground import Ground, junction_ground
from synth.streets.keys import Corners, CycleLanes, ParkingStrip, Sizes
from synth.traffic.network import Network


@dataclass(frozen=True, kw_only=True)
class Crossroads(Corners, CycleLanes, ParkingStrip, Sizes):
    """Two streets that cross at the origin, with zebra crossings and parking on both sides. Traffic lights come with
    `[signal]`; without them who comes first goes first, left turns give way."""

    kind: Literal["crossroads"] = "crossroads"
    lanes: int = key("lanes each way", range=(1, 3), default=1)

    def _shape(self, signals: bool) -> Junction:
        arms = [Arm(name, self.arm_m, self.lane_width_m, self.lanes, 0.0, self.cycle_width_m, self.parking_width_m)
                for name in DIRECTIONS]  # fmt: skip
        return junction(arms, self.corner_radius_m, signals=signals)

    def network(self, signals: bool) -> Network:
        return network(self._shape(signals))

    def ground(self, signals: bool) -> Ground:
        return junction_ground(self._shape(signals), self.pavement_width_m)

"""T-junction: a street that ends at another."""

from dataclasses import dataclass
from typing import Literal

from synth.checking import key
from synth.streets.arms import Arm, Junction, junction, network
from synth.streets.ground import Ground, junction_ground
from synth.streets.keys import Corners, CycleLanes, ParkingStrip, Sizes
from synth.traffic.network import Network


@dataclass(frozen=True, kw_only=True)
class TJunction(Corners, CycleLanes, ParkingStrip, Sizes):
    """A street from the south that ends at the street from west to east, which has the right of way."""

    kind: Literal["t-junction"] = "t-junction"
    lanes: int = key("lanes each way of the street from west to east", range=(1, 3), default=1)

    def _shape(self, signals: bool) -> Junction:
        arms = [
            Arm(name, self.arm_m, self.lane_width_m, self.lanes if name != "south" else 1, 0.0, self.cycle_width_m,
                self.parking_width_m)
            for name in ("east", "west", "south")
        ]  # fmt: skip
        return junction(arms, self.corner_radius_m, major=("east", "west"), signals=signals)

    def network(self, signals: bool) -> Network:
        return network(self._shape(signals))

    def ground(self, signals: bool) -> Ground:
        return junction_ground(self._shape(signals), self.pavement_width_m)

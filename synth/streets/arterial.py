"""Arterial: a wide street with a median, crossed by a narrow one."""

from dataclasses import dataclass
from typing import Literal

from synth.checking import key
from synth.streets.arms import DIRECTIONS, Arm, Junction, junction, network
from synth.streets.ground import Ground, junction_ground, median_island
from synth.streets.keys import Corners, CycleLanes, ParkingStrip, Sizes
from synth.traffic.network import Network


@dataclass(frozen=True, kw_only=True)
class Arterial(Corners, CycleLanes, ParkingStrip, Sizes):
    """A street from west to east with several lanes each way and a planted median, crossed by one with a single lane
    each way. Only the narrow one has parking strips."""

    kind: Literal["arterial"] = "arterial"
    lanes: int = key("lanes each way of the wide street", range=(2, 4), default=3)
    median_m: float = key("width of its median", unit="m", range=(1, 20), default=4.0)

    def _shape(self, signals: bool) -> Junction:
        wide = [Arm(name, self.arm_m, self.lane_width_m, self.lanes, self.median_m, self.cycle_width_m)
                for name in ("east", "west")]  # fmt: skip
        narrow = [Arm(name, self.arm_m, self.lane_width_m, 1, 0.0, self.cycle_width_m, self.parking_width_m)
                  for name in DIRECTIONS if name not in ("east", "west")]  # fmt: skip
        return junction([*wide, *narrow], self.corner_radius_m, major=("east", "west"), signals=signals)

    def network(self, signals: bool) -> Network:
        return network(self._shape(signals))

    def ground(self, signals: bool) -> Ground:
        shape = self._shape(signals)
        ground = junction_ground(shape, self.pavement_width_m)
        medians = tuple(median_island(shape.arms[name], shape.stop_m[name] - 0.5) for name in ("east", "west"))
        return Ground(ground.islands + medians, ground.paint, ground.plots, ground.rows, ground.lights, ground.worn)

"""The streets that a scene may name with `[street]`: one file here and one entry in `STREETS` each.

A street is a checked dataclass of its keys that answers with its lanes (`network`) and with the shape of the ground
(`ground`). Traffic keeps to the right; arms point east, north, west and south from the origin.
"""

from typing import Protocol

from synth.streets.arterial import Arterial
from synth.streets.car_park import CarPark
from synth.streets.crossroads import Crossroads
from synth.streets.ground import Ground
from synth.streets.overpass import Overpass
from synth.streets.roundabout import Roundabout
from synth.streets.straight import Straight
from synth.streets.t_junction import TJunction
from synth.traffic.network import Network


class Street(Protocol):
    """What every street can do; `signals`: whether the scene has traffic lights."""

    @property
    def kind(self) -> str: ...

    def network(self, signals: bool) -> Network: ...

    def ground(self, signals: bool) -> Ground: ...


STREETS: dict[str, type] = {
    "straight": Straight,
    "crossroads": Crossroads,
    "t-junction": TJunction,
    "roundabout": Roundabout,
    "arterial": Arterial,
    "car-park": CarPark,
    "overpass": Overpass,
}
UNLIT = ("roundabout", "overpass")  # streets without anything to put lights at

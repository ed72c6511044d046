"""Overpass: a motorway on a viaduct across a street."""

from dataclasses import dataclass, replace
from typing import Literal

from synth.checking import key
from synth.city.mesh import Mesh, circle
from synth.streets.arms import Arm, Junction, network
from synth.streets.ground import KERB_M, Ground, arm_paint, junction_ground
from synth.streets.keys import CycleLanes, ParkingStrip, Sizes
from synth.traffic.network import RUN_UP_M, Network

PARAPET_M = 0.9
SLAB_M = 1.1
SHOULDER_M = 0.8
COLUMN_SPACING_M = 24.0


@dataclass(frozen=True, kw_only=True)
class Overpass(CycleLanes, ParkingStrip, Sizes):
    """A road from south to north on a viaduct, and a street from west to east below it. They do not meet."""

    kind: Literal["overpass"] = "overpass"
    lanes: int = key("lanes each way of the street below", range=(1, 4), default=1)
    upper_lanes: int = key("lanes each way on the viaduct", range=(1, 4), default=2)
    height_m: float = key("height of the viaduct's road", unit="m", range=(5, 30), default=7.0)

    def _lower(self) -> Junction:
        widths = (self.lanes, 0.0, self.cycle_width_m, self.parking_width_m)
        arms = {name: Arm(name, self.arm_m, self.lane_width_m, *widths) for name in ("east", "west")}
        return Junction(arms, dict.fromkeys(arms, 2.0), dict.fromkeys(arms, 1.0), 0.0, frozenset(arms), False, False)

    def _upper(self) -> Junction:
        arms = {name: Arm(name, self.arm_m, 3.5, self.upper_lanes, 1.2, level_m=self.height_m)
                for name in ("north", "south")}  # fmt: skip
        return Junction(arms, dict.fromkeys(arms, 2.0), dict.fromkeys(arms, 1.0), 0.0, frozenset(arms), False, False)

    def network(self, signals: bool) -> Network:  # noqa: ARG002 - nothing to light
        below, above = network(self._lower()), network(self._upper())
        return Network(below.lanes | above.lanes, below.routes | above.routes, (), below.bays, below.walks,
                       below.entries | above.entries)  # fmt: skip

    def ground(self, signals: bool) -> Ground:  # noqa: ARG002
        lower, upper = self._lower(), self._upper()
        ground = junction_ground(lower, self.pavement_width_m, stop_lines=False)
        deck = upper.arms["north"].half_width_m + SHOULDER_M
        paint = [p for name, arm in upper.arms.items() for p in arm_paint(arm, 0.0, stop_line=False)]
        worn = [(path, self.height_m) for path, _ in junction_ground(upper, 2.0).worn]
        street = lower.arms["east"].half_width_m + KERB_M + self.pavement_width_m
        paint = [*ground.paint, *paint]
        plots = {corner: ((deck + 3.0) * (1 if x > 0 else -1), y) for corner, (x, y) in ground.plots.items()}
        return replace(ground, paint=tuple(paint), plots=plots, worn=(*ground.worn, *worn), lights=(),
                       structures=self._viaduct(deck, street))  # fmt: skip

    def _viaduct(self, deck: float, street: float) -> Mesh:
        """The slab, its parapets and median, and columns beside the street below."""
        mesh, top, end = Mesh(), self.height_m, self.arm_m + RUN_UP_M
        mesh.polygon([(-deck, -end, top), (deck, -end, top), (deck, end, top), (-deck, end, top)], "asphalt")
        low = top - SLAB_M
        mesh.polygon([(-deck, end, low), (deck, end, low), (deck, -end, low), (-deck, -end, low)], "concrete")
        for side in (-1, 1):
            x0, x1 = sorted((side * deck, side * (deck + 0.35)))
            mesh.box((x0, -end, low), (x1, end, top + PARAPET_M), "concrete")
        mesh.box((-0.3, -end, top), (0.3, end, top + 0.8), "concrete")
        y = street + 2.5
        while y < end:
            for side in (-1, 1):
                for x in (-0.55 * deck, 0.55 * deck):
                    mesh.prism(circle(0.75, 14, (x, side * y)), 0.0, low, "concrete")
                mesh.box((-deck * 0.85, side * y - 0.8, low - 1.1), (deck * 0.85, side * y + 0.8, low), "concrete")
            y += COLUMN_SPACING_M
        return mesh

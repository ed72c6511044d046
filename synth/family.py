"""Write the controlled family of scenes: where things move and how often that changes, one knob each.

    python -m synth.family scenes/heterogeneity/controlled

Four cars, each of which travels the same way in the same time. One knob spreads them over one, two or four lanes:
over how much ground something moves. The other splits their way: two of them go while two stand, and they change
places once, twice or three times: how often a place changes between motion and rest. At every instant two cars move.
Street, parked cars, buildings, flights and light are the same in all.
"""

import csv
import io
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from synth.files import write_text
from synth.spec import Scene, parse_scene

Array = NDArray[np.float64]

FRAMES, FPS = 72, 8.0
DURATION_S = (FRAMES - 1) / FPS
WAY_M = 12.0  # of each car over the clip
STEP_S = 0.05  # of the table
SPACING_M = 8.0  # from car to car in a lane: none comes nearer than 1.5 m
SPREADS = (1, 2, 4)  # lanes
CHANGES = (1, 2, 3)
# Where the front bumper of the first car of a lane is in the middle of its way, after the stop line.
MIDDLE_M = {1: 22.0, 2: 10.0, 4: -7.0}
ROUTES = {
    1: ("west-east",) * 4,
    2: ("west-east", "west-east", "east-west", "east-west"),
    4: ("west-east", "east-west", "south-north", "north-south"),
}
KINDS = ("saloon", "hatchback", "suv", "saloon")

SCENE = """\
# Of the controlled family (python -m synth.family): four cars over {lanes} lane(s), which go and stand {changes}
# time(s). At every instant two of them move; all else is the same in every scene of this folder.
name = "{name}"
seed = 31

[time]
fps = {fps}
frames = {frames}

[camera]
width_px = 320
height_px = 180
hfov_deg = 66.0

[flight]
kind = "arc"
radius_m = 38.0
altitude_m = 32.0
start_deg = -128.0
sweep_deg = 70.0

[second_flight]
kind = "arc"
radius_m = 42.0
altitude_m = 25.0
start_deg = -35.0
sweep_deg = -70.0

[street]
kind = "crossroads"
arm_m = 90.0

[[blocks]]
corner = "north-east"
kind = "buildings"
floors = [3, 5]

[[blocks]]
corner = "north-west"
kind = "buildings"
floors = [2, 4]

[[blocks]]
corner = "south-west"
kind = "park"

[[blocks]]
corner = "south-east"
kind = "buildings"
floors = [2, 3]

[traffic]
parked_share = 0.45

[tracks]
file = "{name}.csv"
format = "metres"

[render]
samples = 8

[truth]
passes = ["activity"]
"""


@dataclass(frozen=True)
class Member:
    """A scene of the family."""

    lanes: int
    changes: int

    @property
    def name(self) -> str:
        return f"lanes{self.lanes}-changes{self.changes}"

    @property
    def scene(self) -> str:
        """The scene file."""
        return SCENE.format(name=self.name, lanes=self.lanes, changes=self.changes, fps=FPS, frames=FRAMES)

    def table(self) -> str:
        """The table of tracks, CSV."""
        scene: Scene = parse_scene(_without_tracks(self.scene), self.name)
        network = scene.street.network(False)
        times = np.arange(0, DURATION_S + 1.0 + STEP_S, STEP_S)
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("id", "time_s", "x_m", "y_m", "heading_deg", "kind"))
        for car, route in enumerate(ROUTES[self.lanes]):
            path, line = network.route_path(route), network.stop_line_m(route)
            before = ROUTES[self.lanes][:car].count(route)
            along = line + MIDDLE_M[self.lanes] - before * SPACING_M - WAY_M / 2
            places = along + travelled(times, self.changes, second=car >= len(KINDS) // 2)
            points, headings = path.frames(places)
            for time, (x, y), heading in zip(times, points, np.degrees(headings), strict=True):
                row = f"car{car}", f"{time:.2f}", f"{x:.6f}", f"{y:.6f}", f"{heading:.4f}", KINDS[car]
                writer.writerow(row)
        return out.getvalue()


def travelled(times_s: Array, changes: int, *, second: bool) -> Array:
    """Metres [T] that a car has gone: in the first or the second half of each of `changes` equal cycles it speeds up
    evenly and slows down evenly, and stands in the other half."""
    half = DURATION_S / (2 * changes)
    share = (times_s / half - (1.0 if second else 0.0)) / 2  # in cycles
    whole = np.clip(np.floor(share), 0, changes - 1)
    u = np.clip(2 * (share - whole), 0.0, 1.0)  # of the half in which it moves
    moved = np.where(u < 0.5, 2 * u**2, 1 - 2 * (1 - u) ** 2)
    return WAY_M / changes * (whole + np.where(share < 0, 0.0, moved))


def members() -> list[Member]:
    return [Member(lanes, changes) for lanes in SPREADS for changes in CHANGES]


def _without_tracks(text: str) -> dict[str, object]:
    import tomllib

    table = tomllib.loads(text)
    del table["tracks"]
    return table


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for member in members():
        write_text(folder / f"{member.name}.toml", member.scene)
        write_text(folder / f"{member.name}.csv", member.table())


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: python -m synth.family FOLDER\n\n{__doc__}")
    main(Path(sys.argv[1]))

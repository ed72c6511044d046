"""The ground of a street as shapes: raised islands behind kerbs, paint on the asphalt, and where what may stand."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from synth.city.mesh import Mesh
from synth.streets.arms import CROSSING_SETBACK_M, CROSSING_WIDTH_M, Arm, Junction
from synth.traffic.network import KERB_HEIGHT_M
from synth.traffic.paths import Path, Point, rounded

CORNERS: dict[str, tuple[int, int]] = {
    "north-east": (1, 1),
    "north-west": (-1, 1),
    "south-west": (-1, -1),
    "south-east": (1, -1),
}
KERB_M = 0.3
MARKING_HEIGHT_M = 0.004  # thick enough for the ray tracer to tell paint from asphalt
PATCH_HEIGHT_M = 0.002
BEYOND_M = 600.0  # the ground goes on to here


@dataclass(frozen=True)
class Island:
    """Raised ground to the left of the path `kerb`; an open path is closed over the points `beyond`. `surface` covers
    what lies behind kerb and pavement, which for the corners of the scene is up to their blocks."""

    kerb: Path
    beyond: tuple[Point, ...] = ()
    corners: tuple[str, ...] = ()
    surface: str = "grass"
    pavement_m: float = 0.0


@dataclass(frozen=True)
class Paint:
    """A painted polygon on the ground."""

    points: tuple[Point, ...]
    surface: str = "marking"
    level_m: float = 0.0


@dataclass(frozen=True)
class Row:
    """A kerb along which trees and lamps may stand: from, to, and how far behind it the pavement reaches. The road is
    to its right."""

    start: Point
    end: Point
    trees: bool = True
    level_m: float = KERB_HEIGHT_M


@dataclass(frozen=True)
class Ground:
    """All of it. `plots` are the rectangles behind the pavements, by corner: the nearest point to the origin."""

    islands: tuple[Island, ...]
    paint: tuple[Paint, ...]
    plots: dict[str, Point]
    rows: tuple[Row, ...] = ()
    lights: tuple[tuple[float, float, float], ...] = ()  # x, y, heading of who they are for
    worn: tuple[tuple[Path, float], ...] = ()  # wheel tracks: middles of lanes, level
    structures: Mesh = field(default_factory=Mesh)


def raise_island(mesh: Mesh, island: Island, surfaces: dict[str, str]) -> None:
    """Kerb stones, pavement and ground of an island."""
    z = KERB_HEIGHT_M
    chord = 6.0 if island.kerb.length_m < 200 else 11.25
    closed = not island.beyond
    edges = [island.kerb.inset(d).outline(chord) for d in (0.0, KERB_M, KERB_M + island.pavement_m)]
    if island.pavement_m <= 0:
        edges = edges[:2]
    for a, b in itertools.pairwise(edges[0]):
        mesh.polygon([(*a, 0), (*b, 0), (*b, z), (*a, z)], "kerb")
    for (outer, inner), surface in zip(itertools.pairwise(edges), ("kerb", "pavement"), strict=False):
        for k in range(len(outer) - 1):
            mesh.polygon([(*outer[k], z), (*outer[k + 1], z), (*inner[k + 1], z), (*inner[k], z)], surface)
    inner = edges[-1][:-1] if closed else edges[-1]
    surface = surfaces.get(island.corners[0], island.surface) if island.corners else island.surface
    if len(island.corners) == 2:  # a straight side of the street: two corners meet in its middle
        _halves(mesh, inner, island, surfaces, z)
        return
    mesh.polygon([(*p, z) for p in (*inner, *island.beyond)], surface)


def _halves(mesh: Mesh, inner: Sequence[Point], island: Island, surfaces: dict[str, str], z: float) -> None:
    (x0, y0), (x1, y1) = inner[0], inner[-1]
    far = island.beyond
    middle, back = ((x0 + x1) / 2, (y0 + y1) / 2), ((far[0][0] + far[-1][0]) / 2, (far[0][1] + far[-1][1]) / 2)
    if len(inner) > 2:  # not straight: one surface for both
        mesh.polygon([(*p, z) for p in (*inner, *far)], surfaces.get(island.corners[0], island.surface))
        return
    first, second = island.corners
    mesh.polygon([(*p, z) for p in ((x0, y0), middle, back, far[-1])], surfaces.get(first, island.surface))
    mesh.polygon([(*p, z) for p in (middle, (x1, y1), far[0], back)], surfaces.get(second, island.surface))


def corner_islands(shape: Junction, pavement_m: float) -> tuple[Island, ...]:
    """The ground between each arm and the next: a corner with a rounded kerb, or a straight side."""
    order = [name for name in ("east", "north", "west", "south") if name in shape.arms]
    islands = []
    for name, following in zip(order, [*order[1:], order[0]], strict=True):
        arm, other = shape.arms[name], shape.arms[following]
        inwards = other.place(BEYOND_M, -other.half_width_m)  # the kerb on the right of who leaves by the next arm
        outwards = arm.place(BEYOND_M, arm.half_width_m)
        quarter = round(math.remainder(other.angle - arm.angle, 2 * math.pi) / (math.pi / 2)) % 4
        if quarter == 2:
            kerb = rounded([inwards, outwards], 0.0)
            dx, dy = arm.place(0.0, BEYOND_M)
            far = ((outwards[0] + dx, outwards[1] + dy), (inwards[0] + dx, inwards[1] + dy))
            sides = _corners_beside(arm)
            islands.append(Island(kerb, far, (sides[1], sides[0]), pavement_m=pavement_m))
            continue
        meet = (_pick(outwards, inwards, arm)[0], _pick(outwards, inwards, arm)[1])
        kerb = rounded([inwards, meet, outwards], shape.corner_m)
        far_corner = (math.copysign(BEYOND_M, meet[0]), math.copysign(BEYOND_M, meet[1]))
        islands.append(Island(kerb, (far_corner,), (_corner_of(meet),), pavement_m=pavement_m))
    return tuple(islands)


def _pick(outwards: Point, inwards: Point, arm: Arm) -> Point:
    """Where the kerbs of an east-west and a north-south arm meet."""
    return (inwards[0], outwards[1]) if arm.group == "east_west" else (outwards[0], inwards[1])


def _corner_of(point: Point) -> str:
    return f"{'north' if point[1] > 0 else 'south'}-{'east' if point[0] > 0 else 'west'}"


def _corners_beside(arm: Arm) -> tuple[str, str]:
    """The corners to the left of an arm: beside it, and beside the one opposite."""
    return _corner_of(arm.place(1.0, 1.0)), _corner_of(arm.place(-1.0, 1.0))


def plots_behind(shape: Junction, pavement_m: float) -> dict[str, Point]:
    """The near corner of the buildable ground in each corner of the scene."""
    behind = KERB_M + pavement_m + 0.4
    across_x = max([a.half_width_m + behind for a in shape.arms.values() if a.group == "north_south"], default=1.0)
    across_y = max([a.half_width_m + behind for a in shape.arms.values() if a.group == "east_west"], default=1.0)
    plots = {}
    for corner, (sx, sy) in CORNERS.items():
        beside_ns = ("north" if sy > 0 else "south") in shape.arms
        beside_ew = ("east" if sx > 0 else "west") in shape.arms
        plots[corner] = (sx * (across_x if beside_ns else 1.0), sy * (across_y if beside_ew else 1.0))
    return plots


def arm_rows(arm: Arm, start: float, *, trees: bool = True) -> tuple[Row, Row]:
    """Both kerbs of an arm from `start` outwards."""
    near, far = start, 140.0
    half = arm.half_width_m
    return (
        Row(arm.place(far, -half), arm.place(near, -half), trees),
        Row(arm.place(near, half), arm.place(far, half), trees),
    )


def bar(arm: Arm, along: tuple[float, float], across: tuple[float, float], surface: str = "marking") -> Paint:
    """A painted rectangle on an arm."""
    corners = [(along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1])]
    return Paint(tuple(arm.place(a, c) for a, c in corners), surface, arm.level_m)


def arm_paint(arm: Arm, stop: float, *, stop_line: bool = True) -> list[Paint]:
    """Stop line, middle line, lane lines, cycle lanes and the edges of the parking strips of one arm."""
    end, paint = min(arm.length_m, 260.0), []
    half_median, width = 0.5 * arm.median_m, arm.lane_width_m
    inner = arm.carriageway_m - arm.cycle_m
    if arm.cycle_m:
        for side in (-1, 1):
            paint.append(bar(arm, (stop, end), (side * inner, side * arm.carriageway_m), "cycle-lane"))
            paint.append(bar(arm, (stop, end), (side * inner - 0.06, side * inner + 0.06)))
    if stop_line:  # traffic towards the junction is left of the outward direction
        paint.append(bar(arm, (stop, stop + 0.5), (half_median + 0.1, arm.carriageway_m - 0.1)))
    if arm.median_m == 0:
        paint.append(bar(arm, (stop, stop + 12.0), (-0.07, 0.07)))
        paint += [bar(arm, (a, a + 3.0), (-0.07, 0.07)) for a in np.arange(stop + 14.0, end, 6.0)]
    for lane in range(1, arm.lanes):
        for side in (-1, 1):
            across = side * (half_median + lane * width)
            paint.append(bar(arm, (stop, stop + 15.0), (across - 0.06, across + 0.06)))
            paint += [bar(arm, (a, a + 3.0), (across - 0.06, across + 0.06)) for a in np.arange(stop + 18.0, end, 9.0)]
    if arm.parking_m:
        for side in (-1, 1):
            across = side * arm.carriageway_m
            paint.append(bar(arm, (stop, end), (across - 0.05, across + 0.05)))
    if stop_line and arm.lanes > 1:
        for lane in range(arm.lanes):
            paint.append(_arrow(arm, stop + 4.0, arm.offset(lane)))
            paint.append(_arrow(arm, stop + 22.0, arm.offset(lane)))
    return paint


def _arrow(arm: Arm, along: float, across: float) -> Paint:
    """An arrow towards the junction."""
    shape = [(0.0, 0.0), (1.3, 0.55), (1.3, 0.14), (4.0, 0.14), (4.0, -0.14), (1.3, -0.14), (1.3, -0.55)]
    return Paint(tuple(arm.place(along + a, across + c) for a, c in shape), "marking", arm.level_m)


def zebra_paint(arm: Arm, edge: float) -> list[Paint]:
    """The bars of a crossing over an arm."""
    start, half = edge + CROSSING_SETBACK_M, arm.half_width_m
    return [bar(arm, (start, start + CROSSING_WIDTH_M), (float(m) - 0.27, float(m) + 0.27))
            for m in np.arange(-half + 0.55, half - 0.3, 1.05)]  # fmt: skip


def junction_ground(shape: Junction, pavement_m: float, *, stop_lines: bool = True) -> Ground:
    """Everything of a junction of arms; without stop lines the markings meet in its middle."""
    paint: list[Paint] = []
    lights = []
    rows: list[Row] = []
    for name, arm in shape.arms.items():
        stop = shape.stop_m[name]
        paint += arm_paint(arm, stop if stop_lines else 0.0, stop_line=stop_lines)
        if shape.crossings:
            paint += zebra_paint(arm, shape.edge_m[name])
        if shape.signals:
            lights.append((*arm.place(stop, arm.half_width_m + 0.6), arm.angle + math.pi))
        rows += arm_rows(arm, stop + 3.0)
    worn = [(lane, 0.0) for arm in shape.arms.values() for lane in _lanes(arm, shape.stop_m[arm.name])]
    return Ground(
        corner_islands(shape, pavement_m), tuple(paint), plots_behind(shape, pavement_m), tuple(rows),
        tuple(lights), tuple(worn),
    )  # fmt: skip


def _lanes(arm: Arm, stop: float) -> list[Path]:
    return [rounded([place(lane, stop), place(lane, arm.length_m)], 0.0)
            for lane in range(arm.lanes) for place in (arm.inbound, arm.outbound)]  # fmt: skip


def median_island(arm: Arm, start: float) -> Island:
    """The strip between the two directions of an arm, with a rounded nose."""
    half, end = 0.5 * arm.median_m, BEYOND_M
    # Counter-clockwise: the island is on the left of its kerb.
    corners = [(end, -half), (end, half), (start, half), (start, -half), (end, -half)]
    points = [arm.place(a, c) for a, c in corners]
    return Island(rounded(points, [0, 0, half * 0.98, half * 0.98, 0]), surface="grass")

"""The ground: carriageway, kerbs, pavements, the inside of the blocks, markings and what lies on the road."""

import numpy as np

from synth.city.mesh import Mesh, circle
from synth.spec import Street
from synth.traffic.network import (
    ARMS,
    CROSSING_SETBACK_M,
    CROSSING_WIDTH_M,
    half_width,
    junction_radius,
    stop_distance,
)

KERB_M = 0.3
KERB_HEIGHT_M = 0.12
MARKING_HEIGHT_M = 0.004  # thick enough for the ray tracer to tell paint from asphalt
PATCH_HEIGHT_M = 0.002
BEYOND_M = 500.0  # the ground goes on to here
CORNERS = {"north-east": (1, 1), "north-west": (-1, 1), "south-west": (-1, -1), "south-east": (1, -1)}


def street_mesh(street: Street, grounds: dict[str, str], rng: np.random.Generator) -> Mesh:
    """Everything flat. `grounds` names the surface inside each corner's block."""
    mesh = Mesh()
    mesh.polygon([(-BEYOND_M, -BEYOND_M, 0), (BEYOND_M, -BEYOND_M, 0), (BEYOND_M, BEYOND_M, 0),
                  (-BEYOND_M, BEYOND_M, 0)], "asphalt")  # fmt: skip
    for corner, ground in grounds.items():
        _corner(mesh, street, CORNERS[corner], ground)
    for arm in ARMS:
        _markings(mesh, street, arm)
    _wear(mesh, street, rng)
    return mesh


def _outline(street: Street, inset: float) -> list[tuple[float, float]]:
    """The kerb line of the first quadrant moved into the block by `inset`, from north to east."""
    start, bend = half_width(street) + inset, junction_radius(street)
    radius = max(street.corner_radius_m - inset, 0.01)
    centre = max(bend, start)
    angles = np.linspace(np.pi, 1.5 * np.pi, 9)
    arc = [(centre + radius * float(np.cos(a)), centre + radius * float(np.sin(a))) for a in angles]
    return [(start, BEYOND_M), *arc, (BEYOND_M, start)]


def _corner(mesh: Mesh, street: Street, signs: tuple[int, int], ground: str) -> None:
    sx, sy = signs
    edges = [_outline(street, inset) for inset in (0.0, KERB_M, KERB_M + street.pavement_width_m)]
    z = KERB_HEIGHT_M

    def place(point: tuple[float, float], height: float) -> tuple[float, float, float]:
        return sx * point[0], sy * point[1], height

    for k in range(len(edges[0]) - 1):
        a, b = edges[0][k], edges[0][k + 1]
        mesh.polygon([place(a, 0), place(b, 0), place(b, z), place(a, z)], "kerb")
        for inner, outer, surface in ((edges[0], edges[1], "kerb"), (edges[1], edges[2], "pavement")):
            mesh.polygon([place(inner[k], z), place(inner[k + 1], z), place(outer[k + 1], z), place(outer[k], z)],
                         surface)  # fmt: skip
    mesh.polygon([place(p, z) for p in (*edges[2], (BEYOND_M, BEYOND_M))], ground)


def _markings(mesh: Mesh, street: Street, arm: str) -> None:
    """Centre line, stop line, zebra crossing and the edge of the parking strip of one arm."""
    dx, dy = ARMS[arm]
    stop, lane, edge = stop_distance(street), street.lane_width_m, junction_radius(street)

    def bar(along: tuple[float, float], across: tuple[float, float]) -> None:
        corners = [(along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1])]
        mesh.polygon([(dx * a - dy * c, dy * a + dx * c, MARKING_HEIGHT_M) for a, c in corners], "marking")

    bar((stop, stop + 0.45), (0.1, lane - 0.1))  # traffic towards the crossing is left of the outward direction
    bar((stop, stop + 12.0), (-0.07, 0.07))
    for start in np.arange(stop + 14.0, street.arm_m, 6.0):
        bar((start, start + 3.0), (-0.07, 0.07))
    for side in (-1, 1):
        bar((stop, street.arm_m), (side * lane - 0.05, side * lane + 0.05))
    zebra = edge + CROSSING_SETBACK_M
    for middle in np.arange(-half_width(street) + 0.55, half_width(street) - 0.3, 1.05):
        bar((zebra, zebra + CROSSING_WIDTH_M), (middle - 0.27, middle + 0.27))


def _wear(mesh: Mesh, street: Street, rng: np.random.Generator) -> None:
    """Repaired patches and manhole covers: what a surveyor's eye, and structure from motion, holds on to."""
    for dx, dy in ARMS.values():
        for _ in range(7):
            along, across = rng.uniform(4.0, street.arm_m), rng.uniform(-0.85, 0.85) * half_width(street)
            length, width = rng.uniform(1.2, 6.0), rng.uniform(0.7, 1.6)
            corners = [(along, across), (along + length, across), (along + length, across + width),
                       (along, across + width)]  # fmt: skip
            mesh.polygon([(dx * a - dy * c, dy * a + dx * c, PATCH_HEIGHT_M) for a, c in corners], "patch")
        for along in rng.uniform(6.0, street.arm_m, size=4):
            across = rng.choice([-1, 1]) * 0.5 * street.lane_width_m
            ring = circle(0.36, 16, (dx * along - dy * across, dy * along + dx * across))
            mesh.polygon([(x, y, 0.003) for x, y in ring], "iron")

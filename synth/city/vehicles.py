"""Parametric vehicle bodies: a lofted hull, a glazed cabin, wheels and lights. Origin: centre of the footprint on the
ground, x forward, z up."""

import itertools
from dataclasses import dataclass

import numpy as np

from synth.city.mesh import Mesh
from synth.traffic.fleet import BODIES, Body


@dataclass(frozen=True)
class Profile:
    """The side view: heights in shares of the body's height, positions in shares of its length from the rear."""

    belt: float  # lower edge of the side windows
    hood: float  # height of the nose
    tail: float  # height of the rear end
    cabin_base: tuple[float, float]  # where rear window and windscreen meet the belt
    cabin_roof: tuple[float, float]  # where they meet the roof
    inset: float = 0.14  # how far the roof's sides lean in, share of the half width


PROFILES = {
    "hatchback": Profile(0.62, 0.52, 0.60, (0.01, 0.73), (0.12, 0.52)),
    "saloon": Profile(0.62, 0.53, 0.60, (0.13, 0.73), (0.29, 0.54)),
    "suv": Profile(0.60, 0.55, 0.60, (0.01, 0.74), (0.07, 0.56), 0.12),
    "van": Profile(0.58, 0.45, 0.58, (0.0, 0.88), (0.015, 0.72), 0.08),
}

GROUND_CLEARANCE_M = 0.18
WHEEL_RADIUS_M = 0.33


def vehicle_mesh(kind: str) -> Mesh:
    """The mesh of one kind of vehicle; the paint comes from the object that uses it."""
    body, profile = BODIES[kind], PROFILES[kind]
    mesh = Mesh()
    _hull(mesh, body, profile)
    _cabin(mesh, body, profile, windows_to=0.55 if kind == "van" else 0.0)
    for x in (-0.5, 0.5):
        for side in (-1, 1):
            _wheel(mesh, x * body.wheelbase_m, side, 0.5 * body.width_m)
    _lights(mesh, body, profile)
    return mesh


def _hull(mesh: Mesh, body: Body, profile: Profile) -> None:
    """Cross-sections from rear to front, joined by quads."""
    length, half, height = body.length_m, 0.5 * body.width_m, body.height_m
    tail, hood, belt = profile.tail * height, profile.hood * height, profile.belt * height
    rear, front = profile.cabin_base
    # share of length, share of half width, underside, top
    stations = [
        (0.0, 0.86, 0.38, tail - 0.14),
        (0.025, 0.97, 0.24, tail),
        (max(rear, 0.05), 0.995, GROUND_CLEARANCE_M, belt),
        (0.5, 1.0, GROUND_CLEARANCE_M, belt),
        (front, 0.995, GROUND_CLEARANCE_M, belt),
        (0.96, 0.95, 0.22, hood),
        (1.0, 0.78, 0.36, hood - 0.16),
    ]
    sections = []
    for share, wide, low, top in stations:
        x, w = (share - 0.5) * length, half * wide
        middle = low + 0.45 * (top - low)
        ring = [(-0.9 * w, low), (-w, middle), (-0.93 * w, top), (0.93 * w, top), (w, middle), (0.9 * w, low)]
        sections.append([(x, y, z) for y, z in ring])
    for behind, ahead in itertools.pairwise(sections):
        for k in range(6):
            n = (k + 1) % 6
            surface = "bumper" if k == 5 else "paint"
            mesh.polygon([behind[k], ahead[k], ahead[n], behind[n]], surface)
    mesh.polygon(sections[0], "paint")
    mesh.polygon(sections[-1][::-1], "paint")
    for x, share in ((-0.5 * length - 0.004, 0.8), (0.5 * length + 0.004, 0.72)):
        mesh.polygon([(x, -share * half, 0.36), (x, share * half, 0.36), (x, share * half, 0.5),
                      (x, -share * half, 0.5)], "bumper")  # fmt: skip


def _cabin(mesh: Mesh, body: Body, profile: Profile, windows_to: float) -> None:
    """A frustum: glass all round with pillars, a painted roof. Behind the share `windows_to` the sides are panels."""
    length, half = body.length_m, 0.5 * body.width_m
    z0, z1 = profile.belt * body.height_m, body.height_m
    base_rear, base_front = ((share - 0.5) * length for share in profile.cabin_base)
    roof_rear, roof_front = ((share - 0.5) * length for share in profile.cabin_roof)
    low, high = 0.92 * half, (1 - profile.inset) * half * 0.92
    mesh.polygon([(roof_rear, -high, z1), (roof_front, -high, z1), (roof_front, high, z1), (roof_rear, high, z1)],
                 "paint")  # fmt: skip
    back = "paint" if windows_to else "glass"
    mesh.polygon([(base_front, -low, z0), (base_front, low, z0), (roof_front, high, z1), (roof_front, -high, z1)],
                 "glass")  # fmt: skip
    mesh.polygon([(base_rear, low, z0), (base_rear, -low, z0), (roof_rear, -high, z1), (roof_rear, high, z1)],
                 back)  # fmt: skip
    bands = [(0.0, 0.06, "paint"), (0.06, 0.5, "glass"), (0.5, 0.56, "paint"), (0.56, 0.95, "glass"),
             (0.95, 1.0, "paint")]  # fmt: skip
    for side in (-1, 1):
        for start, end, surface in bands:
            xs = [base_rear + s * (base_front - base_rear) for s in (start, end)]
            tops = [roof_rear + s * (roof_front - roof_rear) for s in (start, end)]
            quad = [(xs[0], side * low, z0), (xs[1], side * low, z0), (tops[1], side * high, z1),
                    (tops[0], side * high, z1)]  # fmt: skip
            mesh.polygon(quad[::side], "paint" if end <= windows_to else surface)


def _wheel(mesh: Mesh, x: float, side: int, half_width: float) -> None:
    angles = np.arange(14) * (2 * np.pi / 14)
    outer, inner = side * (half_width + 0.015), side * (half_width - 0.24)
    rim = [(x + WHEEL_RADIUS_M * np.cos(a), WHEEL_RADIUS_M * (1 + np.sin(a))) for a in angles]
    hub = [(x + 0.58 * WHEEL_RADIUS_M * np.cos(a), WHEEL_RADIUS_M * (1 + 0.58 * np.sin(a))) for a in angles]
    for (xa, za), (xb, zb) in zip(rim, [*rim[1:], rim[0]], strict=True):
        mesh.polygon([(xa, inner, za), (xb, inner, zb), (xb, outer, zb), (xa, outer, za)], "tyre")
    mesh.polygon([(px, outer, pz) for px, pz in rim], "tyre")
    mesh.polygon([(px, outer + side * 0.006, pz) for px, pz in hub], "hub")


def _lights(mesh: Mesh, body: Body, profile: Profile) -> None:
    """Lamps and plates just outside the hull's ends."""
    half = 0.5 * body.width_m
    front_z, rear_z = profile.hood * body.height_m - 0.2, profile.tail * body.height_m - 0.2
    for side in (-1, 1):
        for x, z, share, surface in (
            (0.482 * body.length_m, front_z, 0.80, "head-light"),
            (-0.5 * body.length_m - 0.005, rear_z, 0.76, "tail-light"),
        ):
            y0, y1 = side * (share - 0.34) * half, side * share * half
            lean = -0.11 if surface == "head-light" else 0.0
            x_low = x + (0.5 * body.length_m + 0.006 - x if surface == "head-light" else 0.0)
            mesh.polygon([(x_low, y0, z - 0.02), (x_low, y1 * 0.97, z - 0.02), (x_low + lean, y1, z + 0.2),
                          (x_low + lean, y0, z + 0.2)], surface)  # fmt: skip
    x = -0.5 * body.length_m - 0.006
    mesh.polygon([(x, -0.26, 0.52), (x, 0.26, 0.52), (x, 0.26, 0.63), (x, -0.26, 0.63)], "plate")

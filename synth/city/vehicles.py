"""Parametric vehicle bodies: a lofted hull, a glazed cabin, wheels and lights. Origin: centre of the footprint on the
ground, x forward, z up."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from synth.city.mesh import Mesh, circle
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
    """The mesh of one kind of road user; the paint comes from the object that uses it."""
    return OTHERS[kind]() if kind in OTHERS else _car(kind)


def _car(kind: str) -> Mesh:
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


def _wheel(mesh: Mesh, x: float, side: int, half_width: float, radius: float = WHEEL_RADIUS_M) -> None:
    angles = np.arange(14) * (2 * np.pi / 14)
    outer, inner = side * (half_width + 0.015), side * (half_width - 0.24)
    rim = [(x + radius * np.cos(a), radius * (1 + np.sin(a))) for a in angles]
    hub = [(x + 0.58 * radius * np.cos(a), radius * (1 + 0.58 * np.sin(a))) for a in angles]
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


def bus_mesh() -> Mesh:
    """A city bus: a box with a ribbon of windows, doors on the right, hatches on the roof."""
    body, mesh = BODIES["bus"], Mesh()
    half_length, half, top = 0.5 * body.length_m, 0.5 * body.width_m - 0.02, body.height_m - 0.15
    _walls(mesh, half_length, half, 0.32, 1.15, "paint")
    _walls(mesh, half_length - 0.03, half - 0.02, 1.15, 2.35, "glass")
    _walls(mesh, half_length, half, 2.35, top, "paint")
    mesh.polygon([(-half_length, -half, top), (half_length, -half, top), (half_length, half, top),
                  (-half_length, half, top)], "bus-roof")  # fmt: skip
    for x in np.arange(-half_length + 0.8, half_length - 0.5, 1.45):
        for side in (-1, 1):
            y0, y1 = sorted((side * (half - 0.03), side * half))
            mesh.box((x - 0.05, y0, 1.15), (x + 0.05, y1, 2.35), "bumper")
    for x in (-1.2, 4.4):  # doors, on the kerb's side
        mesh.polygon([(x, -half - 0.004, 0.4), (x + 1.25, -half - 0.004, 0.4), (x + 1.25, -half - 0.004, 2.3),
                      (x, -half - 0.004, 2.3)], "glass")  # fmt: skip
    for x, length in ((-3.8, 2.4), (0.5, 1.2), (3.4, 1.8)):
        mesh.box((x, -0.7, top), (x + length, 0.7, top + 0.14), "trim")
    for x in (-0.5 * body.wheelbase_m - 0.3, 0.5 * body.wheelbase_m):
        for side in (-1, 1):
            _wheel(mesh, x, side, half - 0.005, 0.48)
    _end_lights(mesh, half_length, half, 0.75)
    return mesh


def truck_mesh() -> Mesh:
    """A delivery lorry: a cab with a windscreen, and a box."""
    body, mesh = BODIES["truck"], Mesh()
    half_length, half = 0.5 * body.length_m, 0.5 * body.width_m - 0.02
    cab = half_length - 1.9
    mesh.box((cab, -half + 0.06, 0.45), (half_length, half - 0.06, 1.35), "paint")
    mesh.box((cab, -half + 0.08, 1.35), (half_length - 0.1, half - 0.08, 2.1), "glass")
    mesh.box((cab, -half + 0.06, 2.1), (half_length - 0.16, half - 0.06, 2.65), "paint")
    mesh.box((cab - 0.1, -half + 0.3, 0.6), (cab, half - 0.3, 1.5), "bumper")
    mesh.box((-half_length, -half, 0.95), (cab - 0.25, half, body.height_m - 0.02), "truck-box")
    mesh.box((-half_length + 0.2, -half + 0.35, 0.5), (cab, half - 0.35, 0.95), "bumper")
    for x in (-0.5 * body.wheelbase_m, 0.5 * body.wheelbase_m):
        for side in (-1, 1):
            _wheel(mesh, x, side, half - 0.005, 0.46)
    _end_lights(mesh, half_length, half, 0.7)
    return mesh


def cyclist_mesh() -> Mesh:
    """A rider on a bicycle."""
    mesh, radius = Mesh(), 0.33
    for x in (-0.525, 0.525):
        ring = [(x + radius * np.cos(a), radius * (1.0 + np.sin(a))) for a in np.arange(14) * (2 * np.pi / 14)]
        hole = [(x + 0.85 * (px - x), radius + 0.85 * (pz - radius)) for px, pz in ring]
        for k in range(14):
            n = (k + 1) % 14
            for y in (-0.025, 0.025):
                mesh.polygon([(ring[k][0], y, ring[k][1]), (ring[n][0], y, ring[n][1]), (hole[n][0], y, hole[n][1]),
                              (hole[k][0], y, hole[k][1])], "tyre")  # fmt: skip
            mesh.polygon([(ring[k][0], -0.025, ring[k][1]), (ring[n][0], -0.025, ring[n][1]),
                          (ring[n][0], 0.025, ring[n][1]), (ring[k][0], 0.025, ring[k][1])], "tyre")  # fmt: skip
    _limb(mesh, (-0.525, 0, 0.33), (0.35, 0, 0.75), 0.03, "metal")
    _limb(mesh, (-0.2, 0, 0.4), (-0.25, 0, 0.9), 0.03, "metal")
    _limb(mesh, (0.525, 0, 0.33), (0.4, 0, 1.0), 0.03, "metal")
    _limb(mesh, (0.4, -0.27, 1.02), (0.4, 0.27, 1.02), 0.025, "bumper")
    for side, knee in ((-1, 0.75), (1, 0.55)):
        _limb(mesh, (-0.2, side * 0.1, 0.92), (0.15, side * 0.12, knee), 0.09, "cloth")
        _limb(mesh, (0.15, side * 0.12, knee), (-0.02, side * 0.12, knee - 0.42), 0.07, "cloth")
        _limb(mesh, (0.08, side * 0.2, 1.32), (0.38, side * 0.22, 1.04), 0.055, "paint")
    _limb(mesh, (-0.22, 0, 0.92), (0.1, 0, 1.42), 0.19, "paint")
    _head(mesh, (0.19, 0.0, 1.6), helmet=True)
    return mesh


def pedestrian_mesh() -> Mesh:
    """Someone in mid-stride."""
    mesh = Mesh()
    for side, swing in ((-1, 0.18), (1, -0.18)):
        _limb(mesh, (0, side * 0.09, 0.88), (swing, side * 0.1, 0.05), 0.085, "cloth")
        _limb(mesh, (0, side * 0.2, 1.38), (-0.8 * swing, side * 0.24, 0.85), 0.055, "paint")
    _limb(mesh, (0, 0, 0.85), (0.02, 0, 1.45), 0.19, "paint")
    _head(mesh, (0.02, 0.0, 1.62), helmet=False)
    return mesh


def _walls(mesh: Mesh, half_length: float, half: float, z0: float, z1: float, surface: str) -> None:
    base = [(-half_length, -half), (half_length, -half), (half_length, half), (-half_length, half)]
    for (xa, ya), (xb, yb) in zip(base, [*base[1:], base[0]], strict=True):
        mesh.polygon([(xa, ya, z0), (xb, yb, z0), (xb, yb, z1), (xa, ya, z1)], surface)
    mesh.polygon([(x, y, z0) for x, y in base][::-1], "bumper")


def _end_lights(mesh: Mesh, half_length: float, half: float, z: float) -> None:
    for side in (-1, 1):
        y0, y1 = sorted((side * 0.6 * half, side * 0.92 * half))
        front, rear = half_length + 0.006, -half_length - 0.006
        mesh.polygon([(front, y0, z), (front, y1, z), (front, y1, z + 0.2), (front, y0, z + 0.2)], "head-light")
        mesh.polygon([(rear, y1, z), (rear, y0, z), (rear, y0, z + 0.2), (rear, y1, z + 0.2)], "tail-light")


def _limb(mesh: Mesh, start: Sequence[float], end: Sequence[float], radius: float, surface: str) -> None:
    """A six-sided bar with closed ends."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    axis = (b - a) / np.linalg.norm(b - a)
    side = np.cross(axis, [0, 1, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    ring = [radius * (np.cos(t) * side + np.sin(t) * other) for t in np.arange(6) * (np.pi / 3)]
    for k in range(6):
        n = (k + 1) % 6
        mesh.polygon([a + ring[k], a + ring[n], b + ring[n], b + ring[k]], surface)
    mesh.polygon([a + r for r in ring][::-1], surface)
    mesh.polygon([b + r for r in ring], surface)


def _head(mesh: Mesh, centre: tuple[float, float, float], helmet: bool) -> None:
    x, y, z = centre
    mesh.prism(circle(0.10, 8, (x, y)), z - 0.13, z + 0.03, "skin")
    mesh.prism(circle(0.115, 8, (x, y)), z + 0.03, z + 0.13, "lamp" if helmet else "cloth")


OTHERS: dict[str, Callable[[], Mesh]] = {
    "bus": bus_mesh,
    "truck": truck_mesh,
    "cyclist": cyclist_mesh,
    "pedestrian": pedestrian_mesh,
}

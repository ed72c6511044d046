"""What stands along streets; origin at the foot, +x points to the road."""

from collections.abc import Callable

from synth.city.mesh import Mesh, circle


def lamp() -> Mesh:
    """A lamp post of eight metres."""
    mesh = Mesh()
    mesh.prism(circle(0.09, 8), 0.0, 7.6, "metal")
    mesh.box((-0.06, -0.06, 7.5), (2.2, 0.06, 7.62), "metal")
    mesh.box((1.5, -0.16, 7.38), (2.4, 0.16, 7.52), "lamp", top="metal")
    return mesh


def signal() -> Mesh:
    """A post with a head of three lamps that looks along +x, to who waits at the line."""
    mesh = Mesh()
    mesh.prism(circle(0.07, 8), 0.0, 3.2, "metal")
    mesh.box((-0.18, -0.18, 2.3), (0.18, 0.18, 3.3), "bumper")
    return mesh


def bench() -> Mesh:
    mesh = Mesh()
    for y in (-0.7, 0.62):
        mesh.box((-0.2, y, 0.0), (0.2, y + 0.08, 0.42), "metal")
    mesh.box((-0.24, -0.85, 0.42), (0.24, 0.85, 0.48), "wood")
    mesh.box((-0.28, -0.85, 0.55), (-0.22, 0.85, 0.85), "wood")
    return mesh


def litter_bin() -> Mesh:
    mesh = Mesh()
    mesh.prism(circle(0.26, 10), 0.0, 0.9, "bumper")
    return mesh


def hydrant() -> Mesh:
    mesh = Mesh()
    mesh.prism(circle(0.13, 8), 0.0, 0.65, "awning", (0.5, 0.03, 0.02))
    mesh.prism(circle(0.17, 8), 0.65, 0.78, "awning", (0.5, 0.03, 0.02))
    return mesh


def sign() -> Mesh:
    """A round sign on a post, seen from along the street."""
    mesh = Mesh()
    mesh.prism(circle(0.04, 6), 0.0, 2.5, "metal")
    ring = circle(0.33, 14)
    mesh.polygon([(y, 0.05, 2.4 + z) for y, z in ring][::-1], "awning", (0.7, 0.7, 0.7))
    mesh.polygon([(y, -0.05, 2.4 + z) for y, z in ring], "awning", (0.45, 0.02, 0.02))
    return mesh


def bollard() -> Mesh:
    mesh = Mesh()
    mesh.prism(circle(0.08, 8), 0.0, 0.95, "bumper")
    mesh.prism(circle(0.085, 8), 0.7, 0.82, "marking")
    return mesh


FURNITURE: dict[str, Callable[[], Mesh]] = {
    "lamp": lamp,
    "signal": signal,
    "bench": bench,
    "bin": litter_bin,
    "hydrant": hydrant,
    "sign": sign,
    "bollard": bollard,
}

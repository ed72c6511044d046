"""Polygon meshes with a surface name and a tint for every face."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Point = Sequence[float]
Tint = tuple[float, float, float]
WHITE: Tint = (1.0, 1.0, 1.0)


@dataclass
class Mesh:
    """Polygons over shared or unshared vertices, metres. `surfaces` and `tints` have one entry a face; a tint
    multiplies the surface's colour."""

    vertices: list[tuple[float, float, float]] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)
    surfaces: list[str] = field(default_factory=list)
    tints: list[Tint] = field(default_factory=list)

    def polygon(self, points: Sequence[Point], surface: str, tint: Tint = WHITE) -> None:
        """Add one planar polygon of three or more points."""
        start = len(self.vertices)
        self.vertices.extend((float(x), float(y), float(z)) for x, y, z in points)
        self.faces.append(tuple(range(start, start + len(points))))
        self.surfaces.append(surface)
        self.tints.append(tint)

    def box(self, low: Point, high: Point, surface: str, tint: Tint = WHITE, top: str | None = None) -> None:
        """Add an axis-aligned box without its underside; `top` is the surface of its upper face."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        base = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        self.prism(base, z0, z1, surface, tint, top)

    def prism(
        self,
        base: Sequence[tuple[float, float]],
        z0: float,
        z1: float,
        surface: str,
        tint: Tint = WHITE,
        top: str | None = None,
    ) -> None:
        """Add a vertical prism over a counter-clockwise convex outline, without its underside."""
        for (xa, ya), (xb, yb) in zip(base, [*base[1:], base[0]], strict=True):
            self.polygon([(xa, ya, z0), (xb, yb, z0), (xb, yb, z1), (xa, ya, z1)], surface, tint)
        self.polygon([(x, y, z1) for x, y in base], top or surface, tint)

    def add(self, other: "Mesh", rotation: NDArray[np.float64], offset: Point, scale: float = 1.0) -> None:
        """Add a copy of another mesh, turned by a 3x3 matrix, scaled and moved."""
        start = len(self.vertices)
        placed = np.array(other.vertices).reshape(-1, 3) @ rotation.T * scale + np.asarray(offset)
        self.vertices.extend(map(tuple, placed.tolist()))
        self.faces.extend(tuple(start + i for i in face) for face in other.faces)
        self.surfaces.extend(other.surfaces)
        self.tints.extend(other.tints)

    def digest(self) -> str:
        """SHA-256 of everything the mesh holds."""
        content = repr((self.vertices, self.faces, self.surfaces, self.tints))
        return hashlib.sha256(content.encode()).hexdigest()


def circle(radius: float, count: int, centre: tuple[float, float] = (0.0, 0.0)) -> list[tuple[float, float]]:
    """A regular polygon, counter-clockwise."""
    angles = np.arange(count) * (2 * np.pi / count)
    return [(centre[0] + radius * float(np.cos(a)), centre[1] + radius * float(np.sin(a))) for a in angles]


def turn(angle: float) -> NDArray[np.float64]:
    """Rotation [3, 3] about z, radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])

"""What a corner of the scene is filled with: one function and one entry in `BLOCKS` a kind."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from synth.city.buildings import building, hall, house, office
from synth.city.mesh import Mesh, circle
from synth.traffic.network import KERB_HEIGHT_M

Place = tuple[str, tuple[float, float, float], float, float]  # prop, position, angle, scale
DEPTH_M = 130.0  # built in detail up to here from the origin
FAR_M = 420.0  # and in plain boxes up to here


@dataclass(frozen=True)
class Plot:
    """A quarter of the plane: `near` is its corner next to the streets, `signs` where it lies."""

    near: tuple[float, float]
    signs: tuple[int, int]
    floors: tuple[int, int]

    def at(self, u: float, v: float) -> tuple[float, float]:
        """World x, y of distances from the axes."""
        return self.signs[0] * u, self.signs[1] * v

    @property
    def start(self) -> tuple[float, float]:
        return abs(self.near[0]), abs(self.near[1])

    def box(self, u: tuple[float, float], v: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower and upper corner of a rectangle, world x, y."""
        (x0, x1), (y0, y1) = sorted(self.signs[0] * a for a in u), sorted(self.signs[1] * a for a in v)
        return (x0, y0), (x1, y1)


Fill = Callable[[Mesh, Plot, np.random.Generator], Iterator[Place]]


@dataclass(frozen=True)
class Kind:
    """The ground of a kind of block, and who fills it."""

    surface: str
    fill: Fill


def tree(plot: Plot, u: float, v: float, rng: np.random.Generator, shapes: int = 5) -> Place:
    shape, angle, scale = int(rng.integers(shapes)), float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0.75, 1.25))
    return f"tree-{shape}", _stand(plot, u, v), angle, scale


def _stand(plot: Plot, u: float, v: float) -> tuple[float, float, float]:
    x, y = plot.at(float(u), float(v))
    return x, y, KERB_HEIGHT_M


def _lots(start: float, sizes: tuple[float, float], gaps: tuple[float, ...], rng: np.random.Generator
          ) -> list[tuple[float, float]]:  # fmt: skip
    at, row = start, []
    while at < DEPTH_M:
        size = float(rng.uniform(*sizes))
        row.append((at, at + size))
        at += size + float(rng.choice(gaps))
    return row


def _quad(mesh: Mesh, plot: Plot, u: tuple[float, float], v: tuple[float, float], surface: str, lift: float) -> None:
    (x0, y0), (x1, y1) = plot.box(u, v)
    z = KERB_HEIGHT_M + lift
    mesh.polygon([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], surface)


def far(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> None:
    """Plain buildings behind the detailed ones, for views that reach far."""
    u0, v0 = plot.start
    grid = np.arange(0.0, FAR_M, 30.0)
    for u in u0 + grid:
        for v in v0 + grid:
            draw, w, d, floors = rng.random(), rng.uniform(12, 24), rng.uniform(12, 24), rng.integers(2, 7)
            if (u < DEPTH_M + 4 and v < DEPTH_M + 4) or draw < 0.3:
                continue
            (x0, y0), (x1, y1) = plot.box((float(u), float(u + w)), (float(v), float(v + d)))
            shade = float(rng.uniform(0.55, 1.05))
            tint = (0.50 * shade, 0.44 * shade, 0.37 * shade)
            mesh.box((x0, y0, 0), (x1, y1, 3.2 * float(floors)), "far-wall", tint, top="flat-roof")


def buildings(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """Lots on an irregular grid; most hold a building, some a yard with trees."""
    rows = [_lots(start, (11.0, 17.0), (0.0, 1.5, 4.0), rng) for start in plot.start]
    for i, u in enumerate(rows[0]):
        for j, v in enumerate(rows[1]):
            floors, yard = int(rng.integers(plot.floors[0], plot.floors[1] + 1)), rng.random() < 0.14
            if yard and (i, j) != (0, 0):
                _quad(mesh, plot, u, v, "grass", 0.03)
                for _ in range(4):
                    yield tree(plot, rng.uniform(u[0] + 2, u[1] - 2), rng.uniform(v[0] + 2, v[1] - 2), rng)
                continue
            building(mesh, *plot.box(u, v), KERB_HEIGHT_M, floors, rng)
    far(mesh, plot, rng)


def offices(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """Large blocks of glass and concrete, set back behind paved forecourts with trees."""
    rows = [_lots(start + 5.0, (24.0, 34.0), (10.0, 14.0), rng) for start in plot.start]
    for u in rows[0]:
        for v in rows[1]:
            office(mesh, *plot.box(u, v), KERB_HEIGHT_M, int(rng.integers(plot.floors[0], plot.floors[1] + 1)), rng)
            for share in (0.2, 0.5, 0.8):
                if rng.random() < 0.7:
                    yield tree(plot, u[0] + share * (u[1] - u[0]), v[0] - 2.6, rng, 3)
    far(mesh, plot, rng)


def houses(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """Detached houses in gardens with hedges, drives and trees."""
    rows = [_lots(start + 1.0, (15.0, 20.0), (2.0,), rng) for start in plot.start]
    for u in rows[0]:
        for v in rows[1]:
            w, d = float(rng.uniform(8, 10.5)), float(rng.uniform(8, 11))
            a, b = u[0] + float(rng.uniform(3, max(3.1, u[1] - u[0] - w - 1))), v[0] + float(rng.uniform(3.5, 5))
            house(mesh, *plot.box((a, a + w), (b, b + d)), KERB_HEIGHT_M, rng)
            _quad(mesh, plot, (a + 1.0, a + 3.2), (v[0], b), "pavement", 0.02)
            for edge in ((u[0], u[0] + 0.7), (u[1] - 0.7, u[1])):
                (x0, y0), (x1, y1) = plot.box(edge, v)
                mesh.box((x0, y0, KERB_HEIGHT_M), (x1, y1, KERB_HEIGHT_M + 1.1), "leaves", (0.8, 0.8, 0.8))
            for _ in range(int(rng.integers(1, 4))):
                p, q = rng.uniform(u[0] + 2, u[1] - 2), rng.uniform(v[0] + 1.5, v[1] - 1.5)
                if not (a - 2.5 < p < a + w + 2.5 and b - 2.5 < q < b + d + 2.5):
                    yield tree(plot, p, q, rng)
    far(mesh, plot, rng)


def industry(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """Low halls on wide yards, with containers and few trees."""
    rows = [_lots(start + 4.0, (30.0, 46.0), (14.0, 18.0), rng) for start in plot.start]
    for u in rows[0]:
        for v in rows[1]:
            hall(mesh, *plot.box(u, v), KERB_HEIGHT_M, rng)
            for _ in range(int(rng.integers(2, 7))):
                a, b = float(rng.uniform(u[0], u[1] - 7)), float(v[1] + rng.uniform(2.5, 8))
                (x0, y0), (x1, y1) = plot.box((a, a + 6.06), (b, b + 2.44))
                shades = ((0.35, 0.06, 0.03), (0.04, 0.12, 0.25), (0.10, 0.16, 0.06), (0.4, 0.38, 0.34))
                tint = shades[int(rng.integers(4))]
                mesh.box((x0, y0, KERB_HEIGHT_M), (x1, y1, KERB_HEIGHT_M + 2.59), "awning", tint)
            if rng.random() < 0.6:
                yield tree(plot, u[0] - 2.0, v[0] - 2.0, rng, 3)
    far(mesh, plot, rng)


def park(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """Lawn, gravel paths, a round bed and scattered trees."""
    u0, v0 = plot.start
    z, reach = KERB_HEIGHT_M + 0.02, DEPTH_M - max(u0, v0)
    path = [(0, 0), (2.6, 0), (reach, reach - 2.6), (reach, reach), (reach - 2.6, reach), (0, 2.6)]
    _polygon(mesh, plot, [(u0 + u, v0 + v) for u, v in path], z, "gravel")
    middle = (u0 + 24.0, v0 + 24.0)
    _polygon(mesh, plot, circle(6.5, 32, middle), z + 0.02, "gravel")
    _polygon(mesh, plot, circle(3.0, 24, middle), z + 0.06, "flowers")
    taken: list[tuple[float, float]] = []
    for u, v in rng.uniform(2.5, FAR_M * 0.5, size=(420, 2)):
        p, q = float(u0 + u), float(v0 + v)
        on_path = abs(u - v) < 4.0 or np.hypot(p - middle[0], q - middle[1]) < 9.0
        if on_path or any(np.hypot(p - a, q - b) < 5.0 for a, b in taken):
            continue
        taken.append((p, q))
        yield tree(plot, p, q, rng)


def square(mesh: Mesh, plot: Plot, rng: np.random.Generator) -> Iterator[Place]:
    """A paved square with a fountain, trees in rows and benches, and houses behind it."""
    u0, v0 = plot.start
    size = 42.0
    _quad(mesh, plot, (u0, u0 + size), (v0, v0 + size), "paving", 0.01)
    middle = (u0 + 0.5 * size, v0 + 0.5 * size)
    ground = KERB_HEIGHT_M
    x, y = plot.at(*middle)
    mesh.prism(circle(4.2, 28, (x, y)), ground, ground + 0.5, "kerb")
    mesh.polygon([(*p, ground + 0.52) for p in circle(3.8, 28, (x, y))], "water")
    mesh.prism(circle(0.5, 12, (x, y)), ground + 0.5, ground + 2.6, "trim")
    for along in np.arange(6.0, size - 3.0, 9.0):
        for u, v in ((u0 + along, v0 + 4.0), (u0 + along, v0 + size - 4.0)):
            yield tree(plot, float(u), float(v), rng, 3)
        if abs(along - 0.5 * size) > 6:
            for v in (v0 + 9.0, v0 + size - 9.0):
                yield "bench", _stand(plot, u0 + along, v), float(0.5 * np.pi), 1.0
    rows = [_lots(start, (11.0, 17.0), (0.0, 1.5), rng) for start in (u0, v0)]
    for wide in rows[0]:
        for deep in rows[1]:
            if wide[0] > u0 + size or deep[0] > v0 + size:
                floors = int(rng.integers(plot.floors[0], plot.floors[1] + 1))
                building(mesh, *plot.box(wide, deep), ground, floors, rng)
    far(mesh, plot, rng)


def _polygon(mesh: Mesh, plot: Plot, points: list[tuple[float, float]], z: float, surface: str) -> None:
    placed = [(*plot.at(u, v), z) for u, v in points]
    mesh.polygon(placed if plot.signs[0] * plot.signs[1] > 0 else placed[::-1], surface)


BLOCKS: dict[str, Kind] = {
    "buildings": Kind("court", buildings),
    "offices": Kind("paving", offices),
    "houses": Kind("grass", houses),
    "industry": Kind("yard", industry),
    "park": Kind("grass", park),
    "square": Kind("court", square),
}

"""Puts the city together: one static mesh, and shared meshes with the places where copies of them stand."""

import hashlib
from dataclasses import dataclass

import numpy as np

from synth.city.buildings import building
from synth.city.furniture import lamp_mesh, signal_mesh
from synth.city.greenery import SHAPES, tree_mesh
from synth.city.mesh import Mesh
from synth.city.streets import CORNERS, KERB_HEIGHT_M, KERB_M, street_mesh
from synth.seeds import generator
from synth.spec import Block, Scene, Street
from synth.traffic.network import ARMS, half_width, stop_distance

DEPTH_M = 95.0  # how far from the crossing blocks are built up
LAMP_SPACING_M = 22.0


@dataclass(frozen=True)
class Placement:
    """A copy of the prop `mesh`: position, turn about z in radians, scale."""

    mesh: str
    position: tuple[float, float, float]
    angle: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class City:
    """All that does not move."""

    static: Mesh
    props: dict[str, Mesh]
    placements: tuple[Placement, ...]

    def digest(self) -> str:
        """SHA-256 of the whole city."""
        parts = [self.static.digest(), *(f"{name} {mesh.digest()}" for name, mesh in self.props.items())]
        parts.append(repr(self.placements))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def build_city(scene: Scene) -> City:
    """The streets and blocks of a scene, from its seed."""
    street = scene.street
    grounds = dict.fromkeys(CORNERS, "grass")
    grounds.update({b.corner: "court" if b.kind == "buildings" else "grass" for b in scene.blocks})
    static = street_mesh(street, grounds, generator(scene.seed, "wear"))
    trees = generator(scene.seed, "trees")
    props = {f"tree-{i}": tree_mesh(trees) for i in range(SHAPES)} | {"lamp": lamp_mesh(), "signal": signal_mesh()}
    placements: list[Placement] = []
    for block in scene.blocks:
        rng = generator(scene.seed, f"block {block.corner}")
        if block.kind == "buildings":
            placements += _buildings(static, street, block, rng)
        else:
            placements += _park(static, street, block, rng)
    placements += _street_trees(street, generator(scene.seed, "street trees"))
    placements += _posts(street, signals=scene.signal is not None)
    return City(static, props, tuple(placements))


def _tree(x: float, y: float, rng: np.random.Generator) -> Placement:
    shape, angle, scale = int(rng.integers(SHAPES)), float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0.75, 1.2))
    return Placement(f"tree-{shape}", (float(x), float(y), KERB_HEIGHT_M), angle, scale)


def _buildings(mesh: Mesh, street: Street, block: Block, rng: np.random.Generator) -> list[Placement]:
    """Lots on an irregular grid; most hold a building, some a yard with trees."""
    sx, sy = CORNERS[block.corner]
    start = half_width(street) + KERB_M + street.pavement_width_m + 0.4
    edges = []
    for _ in range(2):
        at, row = start, []
        while at < DEPTH_M:
            size = rng.uniform(11.0, 17.0)
            row.append((at, at + size))
            at += size + rng.choice([1.5, 3.0, 5.0])
        edges.append(row)
    trees = []
    for i, (u0, u1) in enumerate(edges[0]):
        for j, (v0, v1) in enumerate(edges[1]):
            floors, yard = int(rng.integers(block.floors[0], block.floors[1] + 1)), rng.random() < 0.14
            if yard and (i, j) != (0, 0):
                lawn = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
                mesh.polygon([(sx * u, sy * v, KERB_HEIGHT_M + 0.03) for u, v in lawn], "grass")
                for _ in range(4):
                    trees.append(_tree(sx * rng.uniform(u0 + 2, u1 - 2), sy * rng.uniform(v0 + 2, v1 - 2), rng))
                continue
            xs, ys = sorted((sx * u0, sx * u1)), sorted((sy * v0, sy * v1))
            building(mesh, (xs[0], ys[0]), (xs[1], ys[1]), KERB_HEIGHT_M, floors, rng)
    return trees


def _park(mesh: Mesh, street: Street, block: Block, rng: np.random.Generator) -> list[Placement]:
    """Lawn, gravel paths and scattered trees."""
    sx, sy = CORNERS[block.corner]
    start, z = half_width(street) + KERB_M + street.pavement_width_m, KERB_HEIGHT_M + 0.02
    far = DEPTH_M
    path = [(start, start), (start + 2.6, start), (far, far - 2.6), (far, far), (far - 2.6, far),
            (start, start + 2.6)]  # fmt: skip
    mesh.polygon([(sx * u, sy * v, z) for u, v in path], "gravel")
    middle = start + 24.0
    ring = [(middle + 6.5 * np.cos(a), middle + 6.5 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 33)[:-1]]
    mesh.polygon([(sx * u, sy * v, z + 0.02) for u, v in ring], "gravel")
    bed = [(middle + 3.0 * np.cos(a), middle + 3.0 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 25)[:-1]]
    mesh.polygon([(sx * u, sy * v, z + 0.06) for u, v in bed], "grass")
    trees: list[Placement] = []
    taken: list[tuple[float, float]] = []
    for u, v in rng.uniform(start + 2.5, DEPTH_M, size=(160, 2)):
        on_path = abs(u - v) < 4.0 or np.hypot(u - middle, v - middle) < 9.0
        if on_path or any(np.hypot(u - a, v - b) < 5.0 for a, b in taken):
            continue
        taken.append((u, v))
        trees.append(_tree(sx * u, sy * v, rng))
    return trees


def _street_trees(street: Street, rng: np.random.Generator) -> list[Placement]:
    """Trees along the kerbs, away from the crossing."""
    across = half_width(street) + KERB_M + 0.9
    trees = []
    for dx, dy in ARMS.values():
        for side in (-1, 1):
            for along in np.arange(stop_distance(street) + 9.0, DEPTH_M, 13.0):
                along = along + rng.uniform(-1.5, 1.5)
                if rng.random() < 0.7:
                    trees.append(_tree(dx * along - side * dy * across, dy * along + side * dx * across, rng))
    return trees


def _posts(street: Street, signals: bool) -> list[Placement]:
    """Lamps along both streets, and a signal beside every stop line."""
    across = half_width(street) + 0.6
    posts = []
    for dx, dy in ARMS.values():
        for k, along in enumerate(np.arange(stop_distance(street) + 3.0, DEPTH_M, LAMP_SPACING_M)):
            side = 1 if k % 2 else -1
            position = (float(dx * along - side * dy * across), float(dy * along + side * dx * across), KERB_HEIGHT_M)
            # The arm points from the kerb to the middle of the road.
            posts.append(Placement("lamp", position, float(np.arctan2(-side * dx, side * dy))))
        if signals:
            along = stop_distance(street)
            posts.append(Placement("signal", (float(dx * along - dy * across), float(dy * along + dx * across),
                                              KERB_HEIGHT_M)))  # fmt: skip
    return posts

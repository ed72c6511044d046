"""Puts the city together: one static mesh, and shared meshes with the places where copies of them stand."""

import hashlib
import itertools
import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from synth.city.blocks import BLOCKS, Plot
from synth.city.furniture import FURNITURE
from synth.city.greenery import tree_meshes
from synth.city.mesh import Mesh, circle
from synth.seeds import generator
from synth.streets.ground import (
    BEYOND_M,
    CORNERS,
    MARKING_HEIGHT_M,
    PATCH_HEIGHT_M,
    Ground,
    Paint,
    Row,
    raise_island,
)
from synth.traffic.network import KERB_HEIGHT_M
from synth.traffic.paths import Path

LAMP_SPACING_M = 24.0
TREE_SPACING_M = 12.0
FURNITURE_SPACING_M = 19.0
LAMP_BEHIND_KERB_M = 0.6
TREE_BEHIND_KERB_M = 1.2
WORN_HEIGHT_M = 0.001


@dataclass(frozen=True)
class Placement:
    """A copy of the prop `mesh`: position, turn about z in radians, scale."""

    mesh: str
    position: tuple[float, float, float]
    angle: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class City:
    """All that does not move. `land` lies around it, where a frame looks so far."""

    static: Mesh
    props: dict[str, Mesh]
    placements: tuple[Placement, ...]
    land: Mesh = field(default_factory=Mesh)

    def digest(self) -> str:
        """SHA-256 of the whole city."""
        parts = [self.static.digest(), *(f"{name} {mesh.digest()}" for name, mesh in self.props.items())]
        parts.append(repr(self.placements))
        if self.land.faces:
            parts.append(f"land {self.land.digest()}")
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class Block(Protocol):
    """What stands in one corner of the scene."""

    @property
    def corner(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def floors(self) -> tuple[int, int]: ...


def build_city(ground: Ground, blocks: tuple[Block, ...], trees: float, seed: int) -> City:
    """The ground and what stands on it, from a seed; `trees` is the share of the places along kerbs that have one."""
    static = Mesh()
    _sheet(static)
    surfaces = {block.corner: BLOCKS[block.kind].surface for block in blocks}
    for island in ground.islands:
        raise_island(static, island, dict.fromkeys(CORNERS, "grass") | surfaces)
    for paint in ground.paint:
        _paint(static, paint)
    for path, level in ground.worn:
        _wheel_tracks(static, path, level)
    _wear(static, ground, generator(seed, "wear"))
    static.add(ground.structures, np.eye(3), (0, 0, 0))
    placements: list[Placement] = []
    for block in blocks:
        sx, sy = CORNERS[block.corner]
        plot = Plot(ground.plots[block.corner], (sx, sy), block.floors)
        rng = generator(seed, f"block {block.corner}")
        placements += [Placement(*place) for place in BLOCKS[block.kind].fill(static, plot, rng)]
    placements += _along_kerbs(ground, trees, seed)
    used = {placement.mesh for placement in placements}
    props = tree_meshes(generator(seed, "trees")) | {name: make() for name, make in FURNITURE.items()}
    return City(static, {name: mesh for name, mesh in props.items() if name in used}, tuple(placements))


def _sheet(mesh: Mesh) -> None:
    far = BEYOND_M
    mesh.polygon([(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], "asphalt")


def _paint(mesh: Mesh, paint: Paint) -> None:
    z = paint.level_m + (PATCH_HEIGHT_M if paint.surface == "cycle-lane" else MARKING_HEIGHT_M)
    points = [(*p, z) for p in paint.points]
    area = sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise([*points, points[0]]))
    mesh.polygon(points if area > 0 else points[::-1], paint.surface)


def _wheel_tracks(mesh: Mesh, path: Path, level: float) -> None:
    """Two darker strips where wheels roll."""
    z = level + WORN_HEIGHT_M
    for side in (-0.78, 0.78):
        left, right = (path.inset(side + half).outline(8.0) for half in (0.33, -0.33))
        for k in range(len(left) - 1):
            mesh.polygon([(*right[k], z), (*right[k + 1], z), (*left[k + 1], z), (*left[k], z)], "worn")


def _wear(mesh: Mesh, ground: Ground, rng: np.random.Generator) -> None:
    """Repaired patches, tar seams and manhole covers along the lanes: what structure from motion holds on to."""
    for path, level in ground.worn:
        if level > 0:
            continue
        near = min(path.length_m, 130.0)
        if near < 20.0:
            continue
        for _ in range(3):
            along, length, width = rng.uniform(2.0, near), rng.uniform(1.2, 6.0), rng.uniform(0.7, 1.7)
            across = rng.uniform(-1.3, 1.3 - width)
            _patch(mesh, path, (along, along + length), (across, across + width), "patch")
        for _ in range(3):
            along, across = rng.uniform(2.0, near), rng.uniform(-1.2, 1.2)
            _patch(mesh, path, (along, along + rng.uniform(4, 14)), (across, across + 0.07), "tar")
        for along in rng.uniform(4.0, near, size=2):
            (x, y), _ = path.frames(np.array(along))
            mesh.polygon([(*p, 0.003) for p in circle(0.36, 16, (float(x), float(y)))], "iron")


def _patch(mesh: Mesh, path: Path, along: tuple[float, float], across: tuple[float, float], surface: str) -> None:
    s = np.linspace(*along, 2 if len(path.pieces) == 1 and path.pieces[0].curvature == 0 else 7)
    right, left = path.beside(s, np.full(len(s), across[0])), path.beside(s, np.full(len(s), across[1]))
    for k in range(len(s) - 1):
        corners = (right[k], right[k + 1], left[k + 1], left[k])
        mesh.polygon([(*p, PATCH_HEIGHT_M) for p in corners], surface)


def _along_kerbs(ground: Ground, trees: float, seed: int) -> list[Placement]:
    """Trees, lamps and small furniture behind the kerbs, signals beside the stop lines."""
    rng = generator(seed, "street trees")
    small = generator(seed, "street furniture")
    placements = []
    for number, row in enumerate(ground.rows):
        length = math.dist(row.start, row.end)
        toward_road = _heading(row) - 0.5 * math.pi
        outwards = math.hypot(*row.start) < math.hypot(*row.end)
        for k in range(int(length / LAMP_SPACING_M)):
            if k % 2 != number % 2:
                along = (k + 0.35) * LAMP_SPACING_M
                along = along if outwards else length - along
                placements.append(Placement("lamp", _beside(row, along, LAMP_BEHIND_KERB_M), toward_road))
        for k in range(int((length - 8.0) / TREE_SPACING_M)):
            along = 8.0 + k * TREE_SPACING_M + float(rng.uniform(-1.5, 1.5))
            along = along if outwards else length - along
            draw, place = rng.random(), _beside(row, along, TREE_BEHIND_KERB_M)
            shape, angle = int(rng.integers(3)), float(rng.uniform(0, 2 * math.pi))
            scale = float(rng.uniform(0.75, 1.2))
            if row.trees and draw < trees:
                placements.append(Placement(f"tree-{shape}", place, angle, scale))
        for k in range(int((length - 5.0) / FURNITURE_SPACING_M)):
            along = 5.0 + k * FURNITURE_SPACING_M + float(small.uniform(-2, 2))
            along = along if outwards else length - along
            name = ("bench", "bin", "hydrant", "sign", "bollard")[int(small.integers(5))]
            behind = 0.6 if name in ("sign", "hydrant", "bollard") else 1.0
            placements.append(Placement(name, _beside(row, along, behind), toward_road))
    for x, y, heading in ground.lights:
        placements.append(Placement("signal", (x, y, KERB_HEIGHT_M), heading + math.pi))
    return placements


def _heading(row: Row) -> float:
    return math.atan2(row.end[1] - row.start[1], row.end[0] - row.start[0])


def _beside(row: Row, along: float, behind: float) -> tuple[float, float, float]:
    heading = _heading(row)
    x = row.start[0] + along * math.cos(heading) - behind * math.sin(heading)
    y = row.start[1] + along * math.sin(heading) + behind * math.cos(heading)
    return x, y, row.level_m

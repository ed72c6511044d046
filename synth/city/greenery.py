"""Trees: a trunk and a crown of jittered leaf clumps. A few shapes, shared by all trees of a scene."""

import numpy as np

from synth.city.mesh import Mesh, circle


def tree_meshes(rng: np.random.Generator) -> dict[str, Mesh]:
    """Three broad-leaved shapes, a slender one and a conifer, by the names of their props; feet at the origin."""
    return {
        "tree-0": broad_leaved(rng),
        "tree-1": broad_leaved(rng, spread=1.3, count=14),
        "tree-2": broad_leaved(rng, spread=0.95, count=10, autumn=0.25),
        "tree-3": broad_leaved(rng, spread=0.6, tall=1.5, count=11),
        "tree-4": conifer(rng),
    }


def broad_leaved(rng: np.random.Generator, spread: float = 1.15, tall: float = 1.0, count: int = 11,
                 autumn: float = 0.0) -> Mesh:  # fmt: skip
    """About six metres tall."""
    mesh = Mesh()
    mesh.prism(circle(0.16, 7), 0.0, 2.6, "bark")
    for _ in range(count):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        centre = np.array([0, 0, 3.0 + 1.1 * tall]) + direction * [spread, spread, 1.0 * tall] * rng.uniform(0.5, 1.0)
        _clump(mesh, centre, float(rng.uniform(0.8, 1.25)), rng, autumn)
    return mesh


def conifer(rng: np.random.Generator) -> Mesh:
    """Rings of needles that narrow upwards, eight metres."""
    mesh = Mesh()
    mesh.prism(circle(0.17, 7), 0.0, 1.2, "bark")
    for level in range(7):
        z, radius = 0.9 + 1.0 * level, 1.9 * (1 - level / 7.6)
        points = 13
        rim = [(radius * float(rng.uniform(0.75, 1.1)) * np.cos(a), radius * float(rng.uniform(0.75, 1.1)) * np.sin(a),
                z + float(rng.uniform(-0.15, 0.1))) for a in np.arange(points) * (2 * np.pi / points)]  # fmt: skip
        for a, b in zip(rim, [*rim[1:], rim[0]], strict=True):
            shade = float(rng.uniform(0.45, 0.8))
            mesh.polygon([a, b, (0, 0, z + 1.7)], "leaves", (shade * 0.8, shade, shade))
    return mesh


def _clump(mesh: Mesh, centre: np.ndarray, radius: float, rng: np.random.Generator, autumn: float) -> None:
    """A sphere of rings whose points are pushed in and out."""
    rings, sectors = 7, 10
    tint = float(rng.uniform(0.7, 1.35))
    bumps = rng.uniform(0.82, 1.15, size=(rings + 1, sectors))
    bumps[[0, -1]] = 1.0
    polar, azimuth = np.linspace(0, np.pi, rings + 1), np.arange(sectors) * (2 * np.pi / sectors)
    grid = np.empty((rings + 1, sectors, 3))
    grid[..., 0] = np.sin(polar)[:, None] * np.cos(azimuth)
    grid[..., 1] = np.sin(polar)[:, None] * np.sin(azimuth)
    grid[..., 2] = np.cos(polar)[:, None] * 0.85
    grid = centre + radius * bumps[..., None] * grid
    for i in range(rings):
        for j in range(sectors):
            n = (j + 1) % sectors
            corners = [grid[i, j], grid[i + 1, j], grid[i + 1, n], grid[i, n]]
            if i == 0:
                corners = corners[:3]
            elif i == rings - 1:
                corners = [corners[0], corners[1], corners[3]]
            shade = tint * float(rng.uniform(0.85, 1.15))
            mesh.polygon(corners, "leaves", (shade * (1 + 2 * autumn), shade * (1 + 0.4 * autumn), shade))

"""Trees: a trunk and a crown of jittered leaf clumps. A few shapes, shared by all trees of a scene."""

import numpy as np

from synth.city.mesh import Mesh, circle

SHAPES = 4


def tree_mesh(rng: np.random.Generator) -> Mesh:
    """One tree about six metres tall; origin at the foot of the trunk."""
    mesh = Mesh()
    mesh.prism(circle(0.16, 7), 0.0, 2.6, "bark")
    for _ in range(9):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        centre = np.array([0, 0, 4.0]) + direction * [1.15, 1.15, 1.0] * rng.uniform(0.5, 1.0)
        _clump(mesh, centre, float(rng.uniform(0.9, 1.35)), rng)
    return mesh


def _clump(mesh: Mesh, centre: np.ndarray, radius: float, rng: np.random.Generator) -> None:
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
            mesh.polygon(corners, "leaves", (shade, shade, shade))

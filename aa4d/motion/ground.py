"""The ground that movers stand on, from what a static model shows: one plane, refined where the land departs from it.

A drone sees mostly ground, and what is not ground (roofs, trees, cars) stands above it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from aa4d.motion.fit import plane_axes

Array = NDArray[np.float64]

SAMPLES = 12_000  # points of the scene that the ground is fitted to
TRIALS = 400
STEEPEST = 0.82  # cosine of the angle between the ground and the world's horizontal
TOLERANCE_PX = 2.0  # at the scene's median depth
CELL_PX = 24.0  # of the height map, at the median depth
MOST_CELLS = 48  # along a side
FEWEST_INLIERS = 0.15  # of the points: below, there is no ground
STIFFNESS = 30.0  # of the height map against bending, beside the points
ROUNDS = 6
BELOW = 4.0  # tolerances: who stands so far above other points is no ground


@dataclass(frozen=True)
class Ground:
    """A plane and the heights of the land above it."""

    origin: Array  # [3] on the plane
    up: Array  # [3] unit, towards the cameras
    cell: float  # world units between two values of `height`
    corner: Array  # [2] of the height map, along `axes` from the origin
    heights: Array  # [R, C] world units above the plane; rows along the second axis
    found: bool  # False: nothing level was there, and the plane is a guess

    @property
    def axes(self) -> Array:
        """[2, 3] unit vectors along the plane."""
        return plane_axes(self.up)

    def height_at(self, points: Array) -> Array:
        """[N]: of the land above the plane, below or above points [N, 3]."""
        place = ((points - self.origin) @ self.axes.T - self.corner) / self.cell
        return np.asarray(map_coordinates(self.heights, [place[:, 1], place[:, 0]], order=1, mode="nearest"))

    def above(self, points: Array) -> Array:
        """[N]: height of points [N, 3] over the land, along `up`."""
        return np.asarray((points - self.origin) @ self.up - self.height_at(points))

    def drop(self, points: Array) -> Array:
        """[N, 3]: the places on the land under points."""
        return np.asarray(points - self.above(points)[:, None] * self.up)

    def lift(self, pixels: Array, viewmat: Array, K: Array, height: float | Array = 0.0) -> Array:
        """[N, 3]: where the rays of pixels [N, 2] meet the land raised by `height`; NaN where they do not.

        Pixel centres lie at + 0.5.
        """
        center = -viewmat[:3, :3].T @ viewmat[:3, 3]
        local = np.stack(
            [(pixels[:, 0] - K[0, 2]) / K[0, 0], (pixels[:, 1] - K[1, 2]) / K[1, 1], np.ones(len(pixels))], axis=1
        )
        rays = local @ viewmat[:3, :3]
        falling = rays @ self.up
        falling = np.where(falling < -1e-3 * np.linalg.norm(rays, axis=1), falling, np.nan)
        start = (center - self.origin) @ self.up
        land = np.zeros(len(pixels))
        points = np.full((len(pixels), 3), np.nan)
        for _ in range(4):
            points = center + rays * ((land + height - start) / falling)[:, None]
            known = np.isfinite(points).all(1)
            land[known] = self.height_at(points[known])
        points[(land + height - start) / falling <= 0] = np.nan
        return points


def project(points: Array, viewmat: Array, K: Array) -> tuple[Array, Array]:
    """Pixels [N, 2] and depth_z [N] of points [N, 3]; NaN behind the camera."""
    local = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = local[:, 2]
    z = np.where(depth > 1e-9, depth, np.nan)
    pixels = np.stack(
        [local[:, 0] / z * K[0, 0] + K[0, 2], local[:, 1] / z * K[1, 1] + K[1, 2]],
        axis=1,
    )
    return pixels, depth


def unproject(depth: NDArray[np.float32], viewmat: Array, K: Array, rows: NDArray, columns: NDArray) -> Array:
    """[N, 3]: the points that pixels show, of depth_z."""
    z = depth[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - K[0, 2]) / K[0, 0] * z, (rows + 0.5 - K[1, 2]) / K[1, 1] * z, z], axis=1)
    return np.asarray((local - viewmat[:3, 3]) @ viewmat[:3, :3])


def find_ground(depth: NDArray[np.float32], viewmat: Array, K: Array) -> Ground | None:
    """The ground under depth_z [V, H, W] (0: nothing) seen from viewmat [V, 4, 4]; None where nothing is seen.

    Where no plane holds a fair share of the points, the ground is level and passes through the middle of what is seen.
    """
    generator = np.random.default_rng(0)
    points = _sample(depth, viewmat, K, generator)
    if len(points) < 3:
        return None
    seen = depth[depth > 0]
    pixel = float(np.median(seen)) / float(K[0, 0])
    tolerance = TOLERANCE_PX * pixel
    centers = -np.einsum("vji,vj->vi", viewmat[:, :3, :3], viewmat[:, :3, 3])
    plane = _ransac(points, tolerance, generator)
    if plane is None:
        above = np.median(centers[:, 2]) >= np.median(points[:, 2])
        level = np.array([0.0, 0.0, 1.0 if above else -1.0])
        return Ground(np.median(points, axis=0), level, pixel * CELL_PX, np.zeros(2), np.zeros((1, 1)), False)
    origin, up = plane
    turned = -up if np.median((centers - origin) @ up) < 0 else up
    return _with_land(origin, turned, points, tolerance, pixel * CELL_PX)


def _sample(depth: NDArray[np.float32], viewmat: Array, K: Array, generator: np.random.Generator) -> Array:
    views = np.unique(np.linspace(0, len(depth) - 1, min(len(depth), 12)).astype(int))
    parts = []
    for v in views:
        rows, columns = np.nonzero(depth[v] > 0)
        if len(rows):
            chosen = generator.choice(len(rows), min(len(rows), SAMPLES // len(views)), replace=False)
            parts.append(unproject(depth[v], viewmat[v], K, rows[chosen], columns[chosen]))
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _ransac(points: Array, tolerance: float, generator: np.random.Generator) -> tuple[Array, Array] | None:
    best: tuple[Array, Array] | None = None
    best_score = 0.0
    few = points[generator.permutation(len(points))[:3000]]
    for _ in range(TRIALS):
        a, b, c = few[generator.choice(len(few), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12:
            continue
        normal = normal / length * (1 if normal[2] >= 0 else -1)
        if normal[2] < STEEPEST:
            continue
        height = (few - a) @ normal
        # What lies under a plane says that it is a roof.
        score = float((np.abs(height) < tolerance).sum()) - float((height < -BELOW * tolerance).sum())
        if score > best_score:
            best, best_score = (a, normal), score
    if best is None:
        return None
    origin, up = best
    for _ in range(5):
        near = points[np.abs((points - origin) @ up) < 1.5 * tolerance]
        if len(near) < max(FEWEST_INLIERS * len(points), 3):
            return None
        origin = near.mean(0)
        normal = np.linalg.svd(near - origin, full_matrices=False)[2][2]
        up = normal * (1 if normal @ up >= 0 else -1)
    return origin, up


def _with_land(origin: Array, up: Array, points: Array, tolerance: float, cell: float) -> Ground:
    """Heights on a grid: stiff, and drawn by the points that are near, so that roofs and trees have no say."""
    axes = plane_axes(up)
    place, height = (points - origin) @ axes.T, (points - origin) @ up
    low, high = np.percentile(place, 1, axis=0), np.percentile(place, 99, axis=0)
    cell = max(cell, float((high - low).max()) / (MOST_CELLS - 1))
    columns, rows = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
    inside = ((place >= low) & (place <= high)).all(1)
    grid, height = (place[inside] - low) / cell, height[inside]
    first = np.minimum(grid.astype(int), [max(columns - 2, 0), max(rows - 2, 0)])
    f = grid - first
    samples = np.arange(len(grid))
    parts, at, of = [], [], []
    for dx in (0, 1):
        for dy in (0, 1):
            x, y = np.minimum(first[:, 0] + dx, columns - 1), np.minimum(first[:, 1] + dy, rows - 1)
            parts.append((f[:, 0] if dx else 1 - f[:, 0]) * (f[:, 1] if dy else 1 - f[:, 1]))
            at.append(y * columns + x)
            of.append(samples)
    cells = rows * columns
    matrix = scipy.sparse.csr_matrix(
        (np.concatenate(parts), (np.concatenate(of), np.concatenate(at))), (len(grid), cells)
    )
    bending = scipy.sparse.vstack(
        [
            scipy.sparse.kron(scipy.sparse.eye(rows), _second_differences(columns)),
            scipy.sparse.kron(_second_differences(rows), scipy.sparse.eye(columns)),
            1e-2 * scipy.sparse.eye(cells),
        ]
    ).tocsr()
    stiff = STIFFNESS * (bending.T @ bending)
    solution = np.zeros(cells)
    for scale in np.geomspace(4 * tolerance, tolerance, ROUNDS):
        off = (height - matrix @ solution) / scale
        weights = 1 / (1 + off**2) ** 2
        weights[off > 4] = 0
        normal = (matrix.T @ matrix.multiply(weights[:, None]) + stiff).tocsc()
        solution = scipy.sparse.linalg.spsolve(normal, matrix.T @ (weights * height))
    return Ground(origin, up, cell, low, solution.reshape(rows, columns), True)


def _second_differences(count: int) -> scipy.sparse.spmatrix:
    if count < 3:
        return scipy.sparse.csr_matrix((0, count))
    return scipy.sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(count - 2, count))

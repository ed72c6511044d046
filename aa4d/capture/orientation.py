"""From the reconstruction's own frame, which is arbitrary, to the world: z up, metres where anything says so.

With satellite positions, the similarity that takes the camera centres to east, north and up (Umeyama 1991), made robust
by re-weighting. Where those positions lie on a line, or there are none, the ground says where up is: the plane that
most points lie on, its normal towards the cameras. Positions that contradict the reconstruction are not used: a
similarity fits anything somehow, at a scale that means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Position
from aa4d.capture.gnss import east_north_up

Floats = NDArray[np.float64]
NOISE_M = 3.0  # error of a satellite position
MIN_SPAN_M = 15.0  # extent of a flight whose positions can give a scale
# Fraction of the flight's own extent (median from its middle, like the error) of positions still used. Random ones
# come to 1, and where a quarter of the extent is unexplained, so is a tenth of the scale and more.
MAX_GNSS_ERROR = 0.25
GROUND_SHARE = 0.01  # thickness of the ground, as a fraction of the viewing distance
TRIALS = 500
REWEIGHTINGS = 20


@dataclass(frozen=True)
class Similarity:
    """x' = scale * rotation @ x + translation."""

    scale: float
    rotation: Floats  # [3, 3]
    translation: Floats  # [3]

    def of_points(self, points: Floats) -> Floats:
        moved: Floats = self.scale * points @ self.rotation.T + self.translation
        return moved

    def then(self, other: Similarity) -> Similarity:
        return Similarity(
            other.scale * self.scale,
            other.rotation @ self.rotation,
            other.scale * other.rotation @ self.translation + other.translation,
        )


@dataclass(frozen=True)
class World:
    to_world: Similarity
    unit: str  # "metres" or "unit"
    scale_from: str  # how the scale was found, in words
    up_from: str
    origin: Position | None  # position of the world's origin
    gnss_error_m: float | None  # median distance of cameras from their satellite positions
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        return {
            "unit": self.unit,
            "scale_from": self.scale_from,
            "up_from": self.up_from,
            "origin": None if self.origin is None else vars(self.origin),
            "gnss_error_m": self.gnss_error_m,
        }


def find_world(
    viewmats: Floats,
    points: Floats,
    positions: list[Position | None],
    altitude_m: float | None,
    seed: int,
) -> World:
    """Find where the cameras stand, which way is up, and how large a unit is.

    Args:
        viewmats: [N, 4, 4], of the frames in presentation order.
        points: [P, 3].
        positions: of the N frames; None where unknown.
        altitude_m: the median distance from cameras to what they see, if no satellite says it.
    """
    centers = centers_of(viewmats)
    distance = viewing_distance(viewmats, points)
    level = level_ground(viewmats, points, distance, seed)
    known = [i for i, p in enumerate(positions) if p is not None]
    notes = []
    if len(known) >= 3:
        first = positions[known[0]]
        assert first is not None
        enu = east_north_up([p for p in positions if p is not None], first)
        spans = np.linalg.svd(enu - enu.mean(axis=0), compute_uv=False) / np.sqrt(len(enu)) * 3
        if spans[0] >= MIN_SPAN_M:
            world = _by_satellite(centers[known], enu, spans, level, points, first)
            error_m = world.gnss_error_m or 0.0
            extent_m = float(np.median(np.linalg.norm(enu - np.median(enu, axis=0), axis=1)))
            # Few positions are fitted the closer the more of their 3 N numbers the similarity's 7 take up.
            freedom = float(np.sqrt(1 - 7 / (3 * len(known))))
            if error_m <= MAX_GNSS_ERROR * freedom * extent_m:
                return replace(world, notes=_unused(altitude_m, world.to_world.scale * distance))
            notes.append(
                f"the satellite positions are not used: they contradict the cameras, by {error_m:.3g} m "
                f"(median, where they lie {extent_m:.3g} m from their middle); are they of this flight?"
            )
        else:
            notes.append(
                f"the satellite positions are not used: the flight spans {spans[0]:.1f} m by them, and they are good "
                f"to some metres; {MIN_SPAN_M:g} m and more would give scale and up"
            )
    elif known:
        notes.append(f"satellite positions are not used: {len(known)} of {len(positions)} frames have one, too few")
    scale = (1.0 if altitude_m is None else altitude_m) / distance
    placed = level.then(Similarity(scale, np.eye(3), np.zeros(3)))
    return World(
        placed,
        "unit" if altitude_m is None else "metres",
        "nothing says it: 1 unit is the median distance from the cameras to what they see"
        if altitude_m is None
        else stated(altitude_m),
        "the ground: the plane that most points lie on",
        None,
        None,
        tuple(notes),
    )


def kept_world(viewmats: Floats, points: Floats, source: str, is_metric: bool, altitude_m: float | None) -> World:
    """The world of cameras that were given with one; `source` names it. An altitude gives a scale where it has none."""
    distance = viewing_distance(viewmats, points)
    scale, unit, scale_from = 1.0, "metres", f"{source}; capture.json says that it is in metres"
    if altitude_m is not None and not is_metric:
        scale, scale_from = altitude_m / distance, stated(altitude_m)
    elif not is_metric:
        unit, scale_from = "unit", f"{source}; nothing says what its unit is"
    notes = _unused(altitude_m, distance) if is_metric else ()
    return World(Similarity(scale, np.eye(3), np.zeros(3)), unit, scale_from, source, None, None, notes)


def _unused(altitude_m: float | None, distance_m: float) -> tuple[str, ...]:
    """A note where an altitude was stated, and the scale is known without."""
    if altitude_m is None:
        return ()
    return (f"--altitude {altitude_m:g} is not used: the scale is known, by which that distance is {distance_m:.3g} m",)


def stated(altitude_m: float) -> str:
    return f"--altitude: the median distance from the cameras to what they see is {altitude_m:g} m"


def centers_of(viewmats: Floats) -> Floats:
    """Camera centres [N, 3]."""
    centers: Floats = -np.einsum("nji,nj->ni", viewmats[:, :3, :3], viewmats[:, :3, 3])
    return centers


def viewing_distance(viewmats: Floats, points: Floats) -> float:
    """Median depth of the points before the cameras."""
    depth = np.einsum("nj,pj->np", viewmats[:, 2, :3], points) + viewmats[:, 2, 3][:, None]
    return float(np.median(depth[depth > 0]))


def level_ground(viewmats: Floats, points: Floats, distance: float, seed: int) -> Similarity:
    """Rigid: the ground at z = 0 and level, the origin below the middle of the flight, x to the first image's right."""
    centers = centers_of(viewmats)
    normal, offset = _ground_plane(points, GROUND_SHARE * distance, np.random.default_rng(seed))
    if (centers @ normal).mean() < offset:
        normal, offset = -normal, -offset
    right = viewmats[0, 0, :3] - (viewmats[0, 0, :3] @ normal) * normal
    if np.linalg.norm(right) < 1e-6:
        right = np.linalg.svd(normal[None])[2][1]
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(normal, right), normal])
    below = np.median(centers, axis=0)
    below = below - (below @ normal - offset) * normal
    return Similarity(1.0, rotation, -rotation @ below)


def _ground_plane(points: Floats, thickness: float, generator: np.random.Generator) -> tuple[Floats, float]:
    """Unit normal and offset of the plane that most points lie on (RANSAC, then least squares over its points)."""
    best = np.zeros(len(points), bool)
    for _ in range(TRIALS):
        a, b, c = points[generator.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length == 0:
            continue
        near = np.abs((points - a) @ (normal / length)) < thickness
        if near.sum() > best.sum():
            best = near
    ground = points[best] if best.sum() >= 3 else points
    middle = ground.mean(axis=0)
    # The direction in which the ground varies least.
    normal = np.linalg.svd(ground - middle, full_matrices=False)[2][2]
    return normal, float(normal @ middle)


def _by_satellite(
    centers: Floats, enu: Floats, spans: Floats, level: Similarity, points: Floats, first: Position
) -> World:
    if spans[1] > max(2 * NOISE_M, 0.05 * spans[0]):
        similarity, up = robust_similarity(centers, enu), "satellite positions"
    else:
        # On a line, a roll about it is unseen: the ground gives up, the positions heading, scale and place.
        similarity = level.then(_about_vertical(level.of_points(centers), enu))
        up = "the ground: the flight is too straight for satellite positions to say it"
    errors = np.linalg.norm(similarity.of_points(centers) - enu, axis=1)
    # Ground level at z = 0, whatever level the altitudes count from.
    ground = float(np.percentile(similarity.of_points(points)[:, 2], 20))
    lowered = similarity.then(Similarity(1.0, np.eye(3), np.array([0.0, 0.0, -ground])))
    origin = Position(first.latitude_deg, first.longitude_deg, first.altitude_m + ground)
    return World(lowered, "metres", "satellite positions", up, origin, float(np.median(errors)))


def robust_similarity(source: Floats, target: Floats) -> Similarity:
    """Least absolute distances by re-weighted least squares, so that a few wild positions do not count."""
    weights = np.ones(len(source))
    similarity = umeyama(source, target, weights)
    for _ in range(REWEIGHTINGS):
        distance = np.linalg.norm(similarity.of_points(source) - target, axis=1)
        weights = 1 / np.maximum(distance, 0.05 * NOISE_M)
        similarity = umeyama(source, target, weights)
    return similarity


def umeyama(source: Floats, target: Floats, weights: Floats | None = None) -> Similarity:
    """The similarity that takes points [N, 3] to points with the least weighted sum of squares (Umeyama 1991)."""
    w = np.ones(len(source)) if weights is None else weights
    w = w / w.sum()
    middle_source, middle_target = w @ source, w @ target
    a, b = source - middle_source, target - middle_target
    U, S, Vt = np.linalg.svd((w[:, None] * b).T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0])
    rotation = U @ np.diag(sign) @ Vt
    scale = float((S * sign).sum() / (w @ (a**2).sum(axis=1)))
    return Similarity(scale, rotation, middle_target - scale * rotation @ middle_source)


def _about_vertical(source: Floats, target: Floats) -> Similarity:
    """The best similarity that leaves up where it is."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    # As complex numbers, the plane's similarities are multiplications.
    plane_a, plane_b = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    factor = (plane_a.conj() @ plane_b) / (plane_a.conj() @ plane_a).real
    scale, angle = float(abs(factor)), float(np.angle(factor))
    rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return Similarity(scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0))

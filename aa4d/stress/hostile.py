"""A capture in which training meets at once what footage has of trouble: ray-cast boxes under a sky, made by code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aa4d.capture.schema import PinholeCamera
from aa4d.capture.writing import Cloud, Shot, write_capture

Floats = NDArray[np.float64]

FRAMES, FPS, WIDTH, HEIGHT, FOCAL_PX = 24, 10.0, 96, 54, 60.0
SAMPLES = 2  # rays along a side of a pixel
WALL_X_M = 10.0  # of the wall's face
CLOSEST_M = 0.1  # of the camera to the wall
AT_WALL = 14  # frame in which it is there
WHITE, BLACK = 6, 11  # frames of nothing else; of the training frames, as those of every 8th are not
BRIGHTER_FROM, BRIGHTER = 18, 2.5  # the exposure jumps
POINTS_OF_A_FRAME, COPIES = 40, 3  # of the initial cloud: every point lies there so often
SKY = (0.62, 0.74, 0.9)


@dataclass(frozen=True)
class Box:
    """An axis-parallel box."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    color: tuple[float, float, float]


WALL = Box((WALL_X_M, -8, 0), (WALL_X_M + 0.3, 8, 5), (0.7, 0.35, 0.25))
# Thinner than a pixel from most places.
POLES = tuple(Box((6, y, 0), (6.04, y + 0.04, 6), (0.15, 0.15, 0.15)) for y in (-6.0, -2.0, 2.0, 6.0))
WIRES = tuple(Box((6, -6, z), (6.02, 6, z + 0.02), (0.1, 0.1, 0.1)) for z in (5.5, 5.9))


def write_hostile_capture(folder: Path) -> None:
    """Thin poles and wires, sky, a white and a black frame, an exposure jump, points that lie there several times, and
    a camera that comes within 0.1 m of a wall, while a car passes."""
    pictures = folder / ".pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    shots, places, colors = [], [], []
    for i in range(FRAMES):
        viewmat = _viewmat(*_flight(i))
        color, hit = _picture(viewmat, _car(i))
        if i in (WHITE, BLACK):
            color = np.full_like(color, i == WHITE)
        elif i >= BRIGHTER_FROM:
            color = np.minimum(color * BRIGHTER, 1)
        Image.fromarray((color * 255).round().astype(np.uint8)).save(pictures / f"{i:06}.png")
        shots.append(Shot(f"{i:06}", f"{i:06}", i / FPS, viewmat))
        seen = np.flatnonzero(np.isfinite(hit).all(axis=1))
        chosen = rng.choice(seen, min(POINTS_OF_A_FRAME, len(seen)), replace=False)
        places.append(hit[chosen])
        colors.append((color.reshape(-1, 3)[chosen] * 255).astype(np.uint8))
    positions, shades = np.tile(np.concatenate(places), (COPIES, 1)), np.tile(np.concatenate(colors), (COPIES, 1))
    cloud = Cloud(positions, shades, np.ones(len(positions)), np.arange(len(positions)))
    K = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]])
    camera = PinholeCamera(WIDTH, HEIGHT, K)
    write_capture(folder, "hostile", pictures, camera, shots, cloud, {"method": "aa4d.stress.hostile"})


def _flight(i: int) -> tuple[Floats, Floats]:
    """The camera's place, and a point that it looks at: to the wall, and off along it."""
    start, at_wall, end = np.array([-12, -5, 6.0]), np.array([WALL_X_M - CLOSEST_M, 0.5, 2.5]), np.array([2, 7.5, 3.5])
    if i <= AT_WALL:
        share = i / AT_WALL
        return start + share * (at_wall - start), np.array([WALL_X_M, 0.5, 2.5 - 0.5 * (1 - share)])
    share = (i - AT_WALL) / (FRAMES - 1 - AT_WALL)
    return at_wall + share * (end - at_wall), np.array([WALL_X_M, 0.5 - 4 * share, 2.5])


def _car(i: int) -> Box:
    y = -7 + 14 * i / (FRAMES - 1)
    return Box((7, y, 0), (8.8, y + 4, 1.5), (0.85, 0.1, 0.1))


def _viewmat(place: Floats, target: Floats) -> Floats:
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ place
    return matrix


def _picture(viewmat: Floats, car: Box) -> tuple[Floats, Floats]:
    """Color [H, W, 3], and where the first ray of each pixel ends [H*W, 3]: NaN in the sky."""
    rows, columns = np.mgrid[: HEIGHT * SAMPLES, : WIDTH * SAMPLES] + 0.5
    x, y = (columns / SAMPLES - WIDTH / 2) / FOCAL_PX, (rows / SAMPLES - HEIGHT / 2) / FOCAL_PX
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ viewmat[:3, :3]
    place = -viewmat[:3, :3].T @ viewmat[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = np.where(rays[:, 2] < 0, -place[2] / rays[:, 2], np.inf)
        base = np.tile([0.45, 0.45, 0.42], (len(rays), 1))
        for box in (WALL, *POLES, *WIRES, car):
            a, b = (np.array(box.low) - place) / rays, (np.array(box.high) - place) / rays
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            is_hit = (enter < leave) & (enter > 0) & (enter < nearest)
            nearest, base[is_hit] = np.where(is_hit, enter, nearest), box.color
        hit = place + nearest[:, None] * rays
    is_sky = ~(nearest < 200)
    hit[is_sky] = np.nan
    pattern = np.sin(2.1 * hit[:, :1]) + np.sin(1.7 * hit[:, 1:2] + hit[:, 2:])
    color = np.where(is_sky[:, None], SKY, np.clip(base * (1 + 0.25 * np.nan_to_num(pattern)), 0, 1))
    fine = color.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES, 3)
    return fine.mean(axis=(1, 3)), hit.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES, 3)[:, 0, :, 0].reshape(-1, 3)

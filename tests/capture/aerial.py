"""A flight over textured ground with flat roofs above it: true cameras, real parallax, no Blender.

Every surface is a horizontal textured square; a picture is one homography a surface, the lowest first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
ALTITUDE_M = 40.0
TEXTURE_PX = 700
Floats = NDArray[np.float64]
K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])


@dataclass(frozen=True)
class Surface:
    """A horizontal square of half the given size around `centre`, at height z."""

    centre: tuple[float, float]
    half_m: float
    z: float
    texture: NDArray[np.uint8]  # [T, T, 3]


def texture(seed: int, size: int = TEXTURE_PX) -> NDArray[np.uint8]:
    """Patches of many sizes: corners for a feature detector on every scale."""
    generator = np.random.default_rng(seed)
    image = np.zeros((size, size, 3), np.float32)
    for cells, share in ((8, 0.35), (32, 0.3), (110, 0.35)):
        coarse = generator.uniform(0, 255, (cells, cells, 3)).astype(np.float32)
        image += share * cv2.resize(coarse, (size, size), interpolation=cv2.INTER_NEAREST)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8), 0, 255).astype(np.uint8)


def town(seed: int = 0) -> list[Surface]:
    """Ground of 120 m and six roofs."""
    generator = np.random.default_rng(1000 + seed)
    surfaces = [Surface((0, 0), 60.0, 0.0, texture(seed))]
    for number in range(6):
        x, y = generator.uniform(-16, 16), generator.uniform(-12, 12)
        surfaces.append(Surface((x, y), 3.0, generator.uniform(4, 9), texture(seed * 10 + number + 1, 90)))
    return sorted(surfaces, key=lambda s: s.z)


def look(centre: Floats, target: Floats) -> Floats:
    """World to camera [4, 4], OpenCV axes, image-up along world y as far as can be."""
    ahead = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(ahead, [0, 1.0, 0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ centre
    return matrix


def arc(frames: int = 9, sweep_deg: float = 60.0) -> list[Floats]:
    """A flight around the middle of the ground, looking down at it by half a right angle and more."""
    angles = np.radians(np.linspace(-sweep_deg / 2, sweep_deg / 2, frames))
    return [look(np.array([24 * np.sin(a), -24 * np.cos(a), ALTITUDE_M]), np.array([0, 0, 1.5])) for a in angles]


def turning(frames: int = 9) -> list[Floats]:
    """A camera that stays in one place and turns."""
    centre = np.array([0.0, -8.0, ALTITUDE_M])
    return [look(centre, np.array([9 * u, 1.5, 0.0])) for u in np.linspace(-0.5, 0.5, frames)]


def picture(
    surfaces: list[Surface], viewmat: Floats, k: Floats = K, size: tuple[int, int] = (WIDTH, HEIGHT)
) -> NDArray[np.uint8]:
    """[H, W, 3]; surfaces the lowest first. Pixel centres at + 0.5."""
    image = np.full((size[1], size[0], 3), 120, np.uint8)
    for s in surfaces:
        side = s.texture.shape[0]
        metres = 2 * s.half_m / side
        # Texture's pixel (column, row), centres whole numbers as OpenCV has them, to the plane in world metres.
        to_world = np.array(
            [
                [metres, 0, s.centre[0] - s.half_m + 0.5 * metres],
                [0, -metres, s.centre[1] + s.half_m - 0.5 * metres],
                [0, 0, s.z],
                [0, 0, 1],
            ]
        )
        homography = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]]) @ k @ viewmat[:3] @ to_world
        warped = cv2.warpPerspective(s.texture, homography, size, flags=cv2.INTER_AREA)
        covered = cv2.warpPerspective(np.full((side, side), 255, np.uint8), homography, size, flags=cv2.INTER_NEAREST)
        image[covered > 0] = warped[covered > 0]
    return image


def pictures(viewmats: list[Floats], surfaces: Callable[[int], list[Surface]] | None = None) -> list[NDArray[np.uint8]]:
    """One picture a camera; `surfaces` gives those of a frame where they change."""
    fixed = town() if surfaces is None else []
    return [picture(fixed if surfaces is None else surfaces(i), v) for i, v in enumerate(viewmats)]


def write(folder: Path, images: list[NDArray[np.uint8]], name: str = "frame_{:04}.png") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for i, image in enumerate(images):
        write_one(folder / name.format(i), image)
    return folder


def write_one(path: Path, image: NDArray[np.uint8]) -> None:
    """OpenCV cannot write to every path on every system; its bytes can."""
    path.write_bytes(cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes())

"""A capture in closed form: a drone line over a coloured plane on which a square slides. Needs no Blender."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData, PlyElement

WIDTH, HEIGHT, FOCAL, ALTITUDE_M = 48, 32, 40.0, 20.0


def viewmat(centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """A nadir camera with image-up along world y."""
    rotation = np.diag([1.0, -1.0, -1.0])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ centre
    return matrix


def square_centre(t: float, travel_m: float = 12.0) -> NDArray[np.float64]:
    return np.array([travel_m * (t - 0.5), 1.0])


def ground_color(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([0.5 + 0.3 * np.sin(0.6 * x), 0.5 + 0.3 * np.cos(0.5 * y), 0.4 + 0 * x], axis=-1)


def write_toy_capture(folder: Path, frames: int = 10, travel_m: float = 12.0, aside_m: float = 0.0) -> Path:
    """Frames, truth and points of the toy scene as docs/formats.md has it; the square travels so far.

    Args:
        aside_m: of the drone's line, to the north.

    Returns:
        `folder`.
    """
    (folder / "frames").mkdir(parents=True)
    (folder / "truth").mkdir()
    K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    index = []
    poses = np.tile(np.eye(4), (frames, 1, 1, 1))
    for i in range(frames):
        t = i / (frames - 1)
        centre = np.array([-2 + 4 * t, aside_m, ALTITUDE_M])
        x = centre[0] + (columns - WIDTH / 2) / FOCAL * ALTITUDE_M
        y = centre[1] - (rows - HEIGHT / 2) / FOCAL * ALTITUDE_M
        square = np.abs(np.stack([x, y], -1) - square_centre(t, travel_m)).max(-1) < 1.5
        color = np.where(square[..., None], [0.9, 0.1, 0.1], ground_color(x, y))
        Image.fromarray((color * 255).round().astype(np.uint8)).save(folder / f"frames/{i:06}.png")
        np.savez_compressed(
            folder / f"truth/{i:06}.npz",
            depth_z=np.full((HEIGHT, WIDTH), ALTITUDE_M, np.float32),
            instance_id=square.astype(np.uint32),
        )
        poses[i, 0, :2, 3] = square_centre(t, travel_m)
        index.append(
            {
                "name": f"{i:06}",
                "image": f"frames/{i:06}.png",
                "truth": f"truth/{i:06}.npz",
                "time_s": i / 10,
                "t": t,
                "split": "test" if i % 8 == 0 else "train",
                "viewmat": viewmat(centre).tolist(),
            }
        )
    np.savez(
        folder / "truth/tracks.npz",
        instance_id=np.array([1], np.uint32),
        time_s=np.arange(frames) / 10,
        object_to_world=poses,
        speed_mps=np.full((frames, 1), 13.3),
        moving=np.ones((frames, 1), bool),
    )
    _write_points(folder / "points.ply")
    document = {
        "format": "aa4d-capture",
        "version": 1,
        "name": "toy",
        "generator": {"program": "tests"},
        "fps": 10.0,
        "camera": {"model": "PINHOLE", "width": WIDTH, "height": HEIGHT, "K": K.tolist()},
        "points": "points.ply",
        "tracks": "truth/tracks.npz",
        "frames": index,
        "instances": [{"id": 1, "name": "square", "class": "car", "dimensions_m": [3, 3, 0]}],
    }
    (folder / "capture.json").write_text(json.dumps(document))
    return folder


def _write_points(path: Path) -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-13, 13, 27), np.linspace(-8, 8, 17)))
    color = (ground_color(x, y) * 255).astype(np.uint8)
    dtype = [(n, "f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")]
    vertex = np.empty(len(x), dtype=dtype)
    for name, values in zip(("x", "y", "z", "red", "green", "blue"), (x, y, 0 * x, *color.T), strict=True):
        vertex[name] = values
    PlyData([PlyElement.describe(vertex, "vertex")]).write(str(path))

"""What the JSON headers of model files and track files have in common, checked (docs/formats.md).

All functions raise ValueError with what is wrong, and KeyError or TypeError where the layout is another.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Doubles = npt.NDArray[np.float64]

# docs/formats.md, "What readers refuse": the limits that aa4d holds as well.
FARTHEST_M = 10_000.0  # a world has a local origin; beyond 10 km float32 loses millimetres
FARTHEST_MODEL_M = 2 * FARTHEST_M  # learning moves what is shown on from points that a capture holds within FARTHEST_M
MOST_PX = 16_384  # along a side
LARGEST_K = 1e6  # pixels
FASTEST_FPS = 1000.0
LONGEST_NAME = 200  # characters of a group's name, bytes of a frame's


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: pixels, OpenCV axes, the centre of pixel (i, j) at (i + 0.5, j + 0.5)."""

    width: int
    height: int
    K: Doubles  # [3, 3]


def require(condition: Any, problem: str) -> None:
    if not condition:
        raise ValueError(problem)


def number(value: Any, name: str) -> float:
    require(type(value) in (int, float) and math.isfinite(value), f"{name} must be a finite number")
    return float(value)


def integer(value: Any, name: str, largest: int) -> int:
    require(type(value) is int and 1 <= value <= largest, f"{name} must be a whole number from 1 to {largest}")
    return int(value)


def array(value: Any, shape: tuple[int, ...], name: str) -> Doubles:
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    require(found.shape == shape and np.isfinite(found).all(), f"{name} must be finite numbers of shape {list(shape)}")
    return found


def pinhole(value: Any) -> Camera:
    require(value["model"] == "PINHOLE", "camera.model must be PINHOLE")
    require(set(value) <= {"model", "width", "height", "K"}, "camera must hold model, width, height and K, no more")
    K = array(value["K"], (3, 3), "camera.K")
    expected = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]])
    require(
        K[0, 0] > 0 and K[1, 1] > 0 and np.array_equal(K, expected), "camera.K must be [[fx,0,cx],[0,fy,cy],[0,0,1]]"
    )
    require(np.abs(K).max() <= LARGEST_K, f"camera.K must hold at most {LARGEST_K:g} pixels")
    width, height = (integer(value[side], f"camera.{side}", MOST_PX) for side in ("width", "height"))
    return Camera(width, height, K)


def poses_images_and_seconds(frames: Any) -> tuple[Doubles, tuple[str, ...], Doubles]:
    """The poses [frames, 4, 4], the images and the seconds [frames] of a model's frames."""
    require(isinstance(frames, list) and frames, "frames must be a list of at least one frame")
    names: set[str] = set()
    times, seconds = [-math.inf], [-math.inf]
    for rank, frame in enumerate(frames):
        name, image = str(frame.get("name", rank)), frame["image"]
        plain = 0 < len(name.encode()) <= LONGEST_NAME and name[0] != "." and not set(name) & set("/\\:\0")
        require(plain and name not in names, f"the name of frame {rank} must be a plain file name of its own")
        inside = isinstance(image, str) and image and not set(image) & set("\\:") and image[0] != "/"
        require(inside and ".." not in image.split("/"), f"image of frame {rank} must be a path in the capture")
        seconds.append(number(frame["time_s"], f"time_s of frame {rank}"))
        require(seconds[-2] < seconds[-1], f"time_s of frame {rank} must rise")
        times.append(number(frame["t"], f"t of frame {rank}"))
        require(times[-2] < times[-1] and 0 <= times[-1] <= 1, f"t of frame {rank} must rise within [0, 1]")
        require(frame["split"] in ("train", "test"), f"split of frame {rank} must be train or test")
        names.add(name)
    require(any(frame["split"] == "train" for frame in frames), "frames must hold one that was trained on")
    viewmats = np.stack([array(frame["viewmat"], (4, 4), f"viewmat of frame {i}") for i, frame in enumerate(frames)])
    rotations = viewmats[:, :3, :3]
    rigid = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 1e-4
    rigid &= (np.linalg.det(rotations) > 0) & (np.abs(viewmats[:, 3] - [0, 0, 0, 1]) <= 1e-9).all(axis=1)
    require(rigid.all(), f"viewmat of frame {int(np.argmin(rigid))} must be a rotation and a translation")
    near = np.abs(np.einsum("nji,nj->ni", rotations, viewmats[:, :3, 3])).max(axis=1) <= FARTHEST_M
    require(near.all(), f"camera of frame {int(np.argmin(near))} must be within {FARTHEST_M:g} m of the origin")
    return viewmats, tuple(frame["image"] for frame in frames), np.array(seconds[1:])

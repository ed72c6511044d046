"""nerfstudio's transforms.json (OpenGL axes, camera to world), and D-NeRF's transforms_train.json of the same layout.

Every key that changes what a frame is or when it was taken is honored or refused; of the others that are not read,
those that some reader honors are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from PIL import Image

from aa4d.capture.intrinsics import check_intrinsics, check_size
from aa4d.capture.pictures import EXTENSIONS, ORIENTATION
from aa4d.capture.schema import is_rigid
from aa4d.errors import InputError
from aa4d.files import read_json_object

NAMES = ("transforms.json", "transforms_train.json")
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")
UNKNOWN_DISTORTION = ("k4", "k5", "k6")  # programs differ in what they mean
READ = {
    *("frames", "file_path", "transform_matrix", "time", "camera_model", "is_fisheye", "w", "h"),
    *("fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y", *DISTORTION, *UNKNOWN_DISTORTION),
}
# How a program scales or numbers its own copy of the scene: nothing that a capture would have otherwise.
IDLE = {
    *("applied_transform", "applied_scale", "aabb_scale", "scale", "offset", "orientation_override"),
    *("auto_scale_poses_override", "colmap_im_id", "sharpness", "rotation"),
}
ORIENTATIONS_ON_THE_SIDE = (5, 6, 7, 8)  # of EXIF


@dataclass(frozen=True)
class Transforms:
    model: Any  # a COLMAP reconstruction; its images go by the pictures' paths inside the folder
    times: dict[str, float]  # "time" of every picture, in whatever unit, or empty
    notes: list[str]  # keys that are not read


def index_of(folder: Path) -> Path | None:
    """The file of cameras in a folder, if there is one."""
    return next((folder / name for name in NAMES if (folder / name).is_file()), None)


def read_transforms(path: Path) -> Transforms:
    """Raises InputError for a camera model or a value that is not understood; it names the key."""
    document = read_json_object(path, "nerfstudio's cameras")
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f'{path}: key "frames" is missing or empty')
    model = pycolmap.Reconstruction()
    cameras: dict[tuple[Any, ...], int] = {}
    times: dict[str, float] = {}
    for number, frame in enumerate(frames, 1):
        try:
            if not isinstance(frame["file_path"], str) or not _is_text(frame["file_path"]):
                raise TypeError("file_path is no text")
            name = _with_ending(frame["file_path"].removeprefix("./"), path.parent)
            key = _camera_values({**document, **frame}, path.parent / name, path)
            matrix = np.array(frame["transform_matrix"], np.float64).reshape(4, 4)
            if "time" in frame:
                times[name] = _number(frame, "time")
                if not np.isfinite(times[name]):
                    raise ValueError(f"time is {times[name]}")
        except KeyError as error:
            raise InputError(f"{path}: key {error} is missing, for frame {number - 1}; export it again") from None
        except (TypeError, ValueError, OverflowError, OSError) as error:  # OSError: a name that no file can have
            raise InputError(f"{path}: frame {number - 1} cannot be understood ({error}); export it again") from None
        if not is_rigid(matrix, 1e-3):
            raise InputError(f"{path}: transform_matrix of {name} is not a rotation and a translation")
        if key not in cameras:
            kind, width, height, *parameters = key
            check_size(width, height, f"{path}: frame {number - 1}")
            camera = pycolmap.Camera(model=kind, width=width, height=height, params=parameters)
            check_intrinsics(camera, f"{path}: frame {number - 1}")
            camera.camera_id = cameras[key] = len(cameras) + 1
            model.add_camera_with_trivial_rig(camera)
        viewmat = np.linalg.inv(matrix @ OPENGL_TO_OPENCV)
        image = pycolmap.Image(name=name, camera_id=cameras[key], image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(viewmat[:3]))
    timed = sum("time" in frame for frame in frames)
    if 0 < timed < len(frames):
        raise InputError(f'{path}: only {timed} of {len(frames)} frames have a "time"; give all or none one')
    unread = sorted({*document, *(key for frame in frames for key in frame)} - READ - IDLE)
    notes = [f"not used of {path.name}: {', '.join(unread)}"] if unread else []
    return Transforms(model, times, notes)


def _is_text(value: str) -> bool:
    """False where it holds half a character, which JSON can write and no file name has."""
    return value == value.encode(errors="replace").decode()


def _with_ending(name: str, folder: Path) -> str:
    """The picture's path, where a file_path lacks the ending as in D-NeRF."""
    if (folder / name).is_file() or Path(name).suffix.lower() in EXTENSIONS:
        return name
    return next((found for ending in (".png", *EXTENSIONS) if (folder / (found := name + ending)).is_file()), name)


def _number(values: dict[str, Any], key: str, default: float | None = None) -> float:
    value = values[key] if default is None else values.get(key, default)
    if isinstance(value, bool):
        raise TypeError(f"{key} is {value}, expected a number")
    return float(value)


def _size(values: dict[str, Any], picture: Path) -> tuple[int, int]:
    """Width and height, those of the picture where neither is stated."""
    if "w" not in values and "h" not in values and picture.is_file():
        try:
            with Image.open(picture) as image:
                is_on_its_side = image.getexif().get(ORIENTATION) in ORIENTATIONS_ON_THE_SIDE
                return image.size[::-1] if is_on_its_side else image.size
        except (OSError, SyntaxError, ValueError) as error:
            raise InputError(f"{picture}: cannot be read as a picture ({error}); copy it again") from None
    width, height = _number(values, "w"), _number(values, "h")
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f"w and h are {width:g} and {height:g}, expected whole pixels")
    return int(width), int(height)


def _camera_values(values: dict[str, Any], picture: Path, path: Path) -> tuple[Any, ...]:
    """COLMAP's name of the model, width, height and parameters."""
    kind = values.get("camera_model", "OPENCV")
    if kind not in PERSPECTIVE or values.get("is_fisheye"):
        name = "a fisheye" if values.get("is_fisheye") else repr(kind)
        raise InputError(f'{path}: camera_model {name} is not supported; expected "OPENCV" or "PINHOLE"')
    if unknown := [name for name in UNKNOWN_DISTORTION if _number(values, name, 0.0) != 0]:
        raise InputError(f"{path}: {unknown[0]} is not supported; undistort the pictures first, or set it to 0")
    width, height = _size(values, picture)

    def focal(key: str, angle: str, side: int, default: float | None) -> float:
        if key not in values and angle in values:
            return 0.5 * side / float(np.tan(0.5 * _number(values, angle)))
        return _number(values, key, default)

    fx = focal("fl_x", "camera_angle_x", width, None)
    fy = focal("fl_y", "camera_angle_y", height, fx)
    center = _number(values, "cx", width / 2), _number(values, "cy", height / 2)
    distortion = [_number(values, name, 0.0) for name in DISTORTION]
    if not any(distortion):
        return ("PINHOLE", width, height, fx, fy, *center)
    if not distortion[-1]:
        return ("OPENCV", width, height, fx, fy, *center, *distortion[:-1])
    return ("FULL_OPENCV", width, height, fx, fy, *center, *distortion, 0.0, 0.0, 0.0)

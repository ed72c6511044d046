"""Pose of the camera and time, view by view; the two are independent (docs/formats.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from aa4d.capture.schema import PinholeCamera, check_name, matrix_of, number_of, pinhole_camera, pose_of
from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.filming.splits import SPLITS
from aa4d.methods.model_file import LoadedModel

PATH_VERSION = 1
UNEVEN = 0.01  # share of a step
PATH_KEYS = frozenset({"format", "version", "fps", "camera", "views"})
VIEW_KEYS = frozenset({"name", "t", "viewmat", "position_m", "look_at_m"})
MOST_VIEWS = 100_000  # a slip of the keyboard should not fill the memory


@dataclass(frozen=True)
class View:
    name: str  # of its pictures
    t: float  # in [0, 1]
    viewmat: NDArray[np.float64]  # [4, 4] world (metres) to camera

    def center(self) -> NDArray[np.float64]:
        """Center of the camera, [3] metres."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


@dataclass(frozen=True)
class CameraPath:
    views: tuple[View, ...]
    at: NDArray[np.float64]  # [views] seconds on the path's own clock, rising from 0; the steps need not be even
    camera: PinholeCamera
    fps: float  # views a second, on the mean

    @property
    def is_even(self) -> bool:
        """Every view lasts as long as the others, as far as anybody sees."""
        return bool(np.abs(np.diff(self.at) * self.fps - 1).max(initial=0) < UNEVEN)

    def as_json(self) -> dict[str, Any]:
        seconds = {} if self.is_even else {"seconds": self.at.tolist()}
        return {
            "camera": self.camera.as_json(),
            "fps": self.fps,
            **seconds,
            "views": [{"name": v.name, "t": v.t, "viewmat": v.viewmat.tolist()} for v in self.views],
        }


def path_of_frames(loaded: LoadedModel, views: str) -> CameraPath:
    """The poses and times of the capture's frames, each at its own second: some may have been left out of a film.

    Raises:
        InputError: there is no such frame.
    """
    frames = [f for f in loaded.frames if f.split in SPLITS[views]]
    if not frames:
        raise InputError(f"{loaded.path}: its capture has no {views} frame; choose other --views")
    at = np.array([f.time_s - frames[0].time_s for f in frames])
    return CameraPath(
        views=tuple(View(f.name, f.t, f.viewmat) for f in frames),
        at=at,
        camera=loaded.camera,
        fps=(len(frames) - 1) / float(at[-1]) if len(frames) > 1 else loaded.fps,
    )


def read_camera_path(file: Path, loaded: LoadedModel) -> CameraPath:
    """A camera path file (docs/formats.md).

    Raises:
        InputError: names the file, the view and what is wrong with it.
    """
    document = read_json_object(file, "a camera path")
    if document.get("format") != "aa4d-camera-path":
        raise InputError(f'{file}: key "format" is {document.get("format")!r}, expected "aa4d-camera-path"')
    if document.get("version") != PATH_VERSION:
        raise InputError(f"{file}: version {document.get('version')!r} is not known here, expected {PATH_VERSION}")
    _check_keys(document, PATH_KEYS, "the path", file)
    fps = number_of(document, "fps", file)
    if not 0 < fps <= 1000:
        raise InputError(f'{file}: key "fps" must be positive and at most 1000, found {fps:g}')
    values = document.get("views")
    if not isinstance(values, list) or not values:
        raise InputError(f'{file}: key "views" is missing or empty')
    views = tuple(_view(value, number, file) for number, value in enumerate(values))
    if len({view.name for view in views}) < len(views):
        raise InputError(f"{file}: two views have the same name; each names its own pictures")
    camera = pinhole_camera(document, file) if "camera" in document else loaded.camera
    return CameraPath(views, np.arange(len(views)) / fps, camera, fps)


def _view(value: Any, number: int, file: Path) -> View:
    if not isinstance(value, dict):
        raise InputError(f"{file}: view {number} is not an object")
    name = str(value.get("name", f"{number:06}"))
    label = f"view {name!r}"
    check_name(name, label, file)
    _check_keys(value, VIEW_KEYS, label, file)
    if ("viewmat" in value) == ("position_m" in value or "look_at_m" in value):
        raise InputError(f"{file}: {label} needs either viewmat, or position_m and look_at_m")
    if "viewmat" in value:
        viewmat = pose_of(value["viewmat"], label, file)
    else:
        eye = matrix_of(value.get("position_m"), (3,), f"position_m of {label}", file)
        target = matrix_of(value.get("look_at_m"), (3,), f"look_at_m of {label}", file)
        if not np.linalg.norm(target - eye) > 1e-6:
            raise InputError(f"{file}: {label} looks at where it stands; position_m and look_at_m must differ")
        viewmat = pose_of(looking_at(eye, target), label, file)
    t = number_of(value, "t", file, label)
    check_time(t, f"{file}: t of {label}")
    return View(name, t, viewmat)


def _check_keys(value: dict[str, Any], known: frozenset[str], label: str, file: Path) -> None:
    if unknown := sorted(value.keys() - known):
        raise InputError(f"{file}: {label} has an unknown key {unknown[0]!r}; known are {', '.join(sorted(known))}")


def check_time(t: float, what: str) -> None:
    if not 0.0 <= t <= 1.0:
        raise InputError(f"{what} must be a number from 0 to 1, the time of the clip, not {t:g}")


def looking_at(eye: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """World-to-camera matrix [4, 4]; up in the image is world z, or world y where the camera looks straight down."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    up = np.array([0.0, 0.0, 1.0]) if np.hypot(forward[0], forward[1]) > 1e-6 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = right, np.cross(forward, right), forward
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat


def resampled(path: CameraPath, count: int) -> CameraPath:
    """`count` views at even seconds of the same path: cubic in position and rotation, linear in time."""
    if not 1 <= count <= MOST_VIEWS:
        raise InputError(f"{count} views: must be at least 1 and at most {MOST_VIEWS}; give another --frames or --fps")
    n = len(path.views)
    at = np.linspace(0, path.at[-1], count)
    if n == 1:
        same = tuple(replace(path.views[0], name=f"{i:06}") for i in range(count))
        return CameraPath(same, np.arange(count) / path.fps, path.camera, path.fps)
    centers = CubicSpline(path.at, np.stack([v.center() for v in path.views]))(at)
    # Of camera to world. A hovering camera turns about nothing, and the spline's divisions by its angle stay finite.
    rotations = RotationSpline(path.at, Rotation.from_matrix(np.stack([v.viewmat[:3, :3].T for v in path.views])))(at)
    times = np.interp(at, path.at, [v.t for v in path.views])
    views = []
    for i in range(count):
        viewmat = np.eye(4)
        viewmat[:3, :3] = rotations[i].as_matrix().T
        viewmat[:3, 3] = -viewmat[:3, :3] @ centers[i]
        views.append(View(f"{i:06}", float(times[i]), viewmat))
    return CameraPath(tuple(views), at, path.camera, max(count - 1, 1) / float(path.at[-1]))


def at_rate(path: CameraPath, fps: float) -> CameraPath:
    """The same path in the same seconds at another frame rate."""
    if not 0 < fps <= 1000:
        raise InputError(f"--fps {fps:g}: must be positive and at most 1000")
    return replace(resampled(path, round(float(path.at[-1]) * fps) + 1), fps=fps)


def with_time(path: CameraPath, t: float) -> CameraPath:
    """Time stands still, the camera moves."""
    check_time(t, "--time")
    return replace(path, views=tuple(replace(view, t=t) for view in path.views))


def with_camera(path: CameraPath, viewmat: NDArray[np.float64]) -> CameraPath:
    """The camera stands still, time runs."""
    return replace(path, views=tuple(replace(view, viewmat=viewmat) for view in path.views))


def only_time(path: CameraPath, t: float) -> CameraPath:
    """One view, at time t; its camera is that of the view nearest in time."""
    check_time(t, "--time")
    nearest = min(range(len(path.views)), key=lambda i: abs(path.views[i].t - t))
    view = replace(path.views[nearest], name="000000", t=t)
    return replace(path, views=(view,), at=path.at[:1])


def instant_path(
    loaded: LoadedModel, views: str, file: Path | None, frames: int | None, fps: float | None, time: float | None
) -> tuple[CameraPath, str]:
    """`named_path` for `aa4d export`, whose --time is the instant that is written, alone.

    Raises:
        InputError: see `named_path`; or a number of views is given for that one.
    """
    if time is None:
        return named_path(loaded, views, file, frames, fps, None, None)
    if frames is not None or fps is not None:
        option = "--frames" if fps is None else "--fps"
        raise InputError(f"--time writes one instant, and {option} resamples many; give one of them")
    path, _ = named_path(loaded, views, file, None, None, None, None)
    return only_time(path, time), f"t{time:g}"


def view_of_frame(loaded: LoadedModel, name: str) -> View:
    """The pose and time of the capture's frame of that name."""
    for frame in loaded.frames:
        if frame.name == name:
            return View(frame.name, frame.t, frame.viewmat)
    first, last = loaded.frames[0].name, loaded.frames[-1].name
    raise InputError(f"{loaded.path}: its capture has no frame {name!r}; they run from {first!r} to {last!r}")


def named_path(
    loaded: LoadedModel,
    views: str,
    file: Path | None,
    frames: int | None,
    fps: float | None,
    time: float | None,
    camera: str | None,
) -> tuple[CameraPath, str]:
    """The camera path that the options of `aa4d render` and `aa4d export` describe, and a name for it.

    Raises:
        InputError: an option is out of its range, or two exclude each other.
    """
    if frames is not None and fps is not None:
        raise InputError("--frames and --fps both say how many views there are; give one of them")
    if file is not None and views != "all":
        raise InputError(
            f"--views {views}: chooses frames of the capture, and --path flies past them; give one of them"
        )
    path = path_of_frames(loaded, views) if file is None else read_camera_path(file, loaded)
    name = [views if file is None else file.stem]
    if frames is not None:
        path = resampled(path, frames)
        name.append(f"{frames}")
    if fps is not None:
        path = at_rate(path, fps)
        name.append(f"{fps:g}fps")
    if time is not None:
        path = with_time(path, time)
        name.append(f"t{time:g}")
    if camera is not None:
        path = with_camera(path, view_of_frame(loaded, camera).viewmat)
        name.append(f"from-{camera}")
    if time is not None and camera is not None and frames is None and fps is None:  # all views would be alike
        path = replace(path, views=path.views[:1], at=path.at[:1])
    return path, "-".join(name)

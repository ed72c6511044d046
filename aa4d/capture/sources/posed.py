"""Frames whose cameras are known already: a COLMAP folder, or a nerfstudio folder with transforms.json."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pycolmap

from aa4d.capture.annotations import read_annotations
from aa4d.capture.clip import Clip
from aa4d.capture.intrinsics import check_intrinsics, check_size
from aa4d.capture.schema import frame_of_index, is_rigid
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source, folder
from aa4d.errors import InputError
from aa4d.files import read_json_object

MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
IMAGE_FOLDERS = ("images", "frames", "input", ".")
MODEL_FILES = ("cameras", "images", "points3D")
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class PosedPictures:
    """A COLMAP reconstruction whose images go by the pictures' labels; without points where the source has none."""

    file: Path  # or folder, that the cameras were read from
    model: Any
    world: str | None  # in words, where the world is kept as it is; None: nothing says how it stands
    is_metric: bool = False

    @property
    def has_points(self) -> bool:
        """Points that know which frames show them; some programs write their points without."""
        return any(p.track.length() > 1 for p in self.model.points3D.values())

    def of_clip(self, clip: Clip) -> Any:
        """A reconstruction of the clip's frames: cameras at the clip's size, images under its file names.

        Raises:
            InputError: the cameras are of pictures of another shape, or several where points are to be triangulated.
        """
        model = pycolmap.Reconstruction(self.model)
        by_label = {frame.label: frame.file for frame in clip.frames}
        for image_id in list(model.reg_image_ids()):
            image = model.image(image_id)
            if image.name in by_label:
                image.name = by_label[image.name]
            else:
                model.deregister_frame(image.frame_id)
        used = {model.image(i).camera_id for i in model.reg_image_ids()}
        if len(used) > 1 and not self.has_points:
            raise InputError(
                f"{self.file}: its frames have {len(used)} cameras, and no points that tell which frames show them; "
                "give frames of one camera, or a COLMAP model whose points have tracks (or the pictures alone, without "
                "cameras)"
            )
        for number in used:
            camera = model.camera(number)
            if not same_shape((camera.width, camera.height), clip.source_size):
                width, height = clip.source_size
                raise InputError(
                    f"{self.file}: its camera is {camera.width}x{camera.height}, which is not the shape of the "
                    f"pictures, {width}x{height}; give the pictures that the cameras were found with"
                )
            camera.rescale(clip.width, clip.height)
        return model


def same_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """True where two sizes are of one picture, made smaller and rounded to whole pixels."""
    small, large = np.array(sorted([one, other]), np.float64)
    return bool(np.abs(large * (small[0] / large[0]) - small).max() <= 1)


def recognises(path: Path) -> bool:
    return path.is_dir() and (_model_folder(path) is not None or (path / "transforms.json").is_file())


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """The pictures that the reconstruction names, in the order of their numbers.

    Of a folder with both kinds of cameras transforms.json is read: its world is upright, a COLMAP model's is arbitrary.
    """
    model_folder, transforms = _model_folder(path), path / "transforms.json"
    times_s: dict[str, float] = {}
    notes: list[str] = []
    if transforms.is_file():
        index, root = transforms, path
        times_s, is_metric = _own_capture(path)
        posed = PosedPictures(index, read_transforms(index), "transforms.json, whose world is kept", is_metric)
        notes += selection.ignored_fps("capture.json") if times_s else []
        if model_folder is not None:
            notes.append(f"cameras are those of transforms.json; {model_folder.relative_to(path)} is not read")
    else:
        assert model_folder is not None
        index, root = model_folder, _image_folder(path)
        posed = PosedPictures(index, _read_colmap(index), None)
    names = [posed.model.image(i).name for i in posed.model.reg_image_ids()]
    files = {name: root / _inside(name, index) for name in names}
    twice = [name for name, count in Counter(_inside(n, index) for n in names).items() if count > 1]
    if twice:
        raise InputError(f"{index}: names the picture {twice[0]} twice; give every frame its own")
    missing = [name for name, file in files.items() if not file.is_file()]
    if len(missing) == len(names):
        raise InputError(f"{root}: holds none of the {len(names)} pictures that {index} names; put them there")
    if missing:
        notes.append(f"{len(missing)} of {len(names)} pictures left out: missing in {root}")
    present = {file: name for name, file in files.items() if name not in missing}
    ordered, numbers = folder.in_order(list(present))
    pictures = []
    for rank, file in enumerate(ordered):
        number = None if numbers is None else numbers[rank]
        at = rank if numbers is None else numbers[rank] - numbers[0]
        picture = folder.picture_of(file, times_s.get(present[file], at / selection.folder_fps), number)
        pictures.append(replace(picture, label=present[file]))
    read = None if annotations is None else read_annotations(annotations, numbers)
    beside = [*index.iterdir()] if index.is_dir() else [index, path / "capture.json"]
    sources = (*ordered, *(p for p in beside if p.is_file()))
    return Source("reconstruction", pictures, lambda: [p.time_s for p in pictures], sources, notes, read, posed)


def _own_capture(path: Path) -> tuple[dict[str, float], bool]:
    """For a capture of ours (docs/formats.md): the seconds of its pictures, and whether its world is in metres."""
    index = path / "capture.json"
    document = read_json_object(index, "the index of a capture") if index.is_file() else {}
    if document.get("format") != "aa4d-capture":
        return {}, False
    frames = [frame_of_index(value, i, index) for i, value in enumerate(document.get("frames") or [])]
    generator = document.get("generator")
    # A capture of footage says of its world whether it is; all others are.
    world = generator.get("world") if isinstance(generator, dict) else None
    is_metric = not isinstance(world, dict) or world.get("unit") == "metres"
    return {frame.image: frame.time_s for frame in frames}, is_metric


def _model_folder(path: Path) -> Path | None:
    for name in MODEL_FOLDERS:
        # Two of the three: one that lacks a file is told so.
        if len(_missing(path / name)) <= 1:
            return path / name
    return None


def _missing(model_folder: Path) -> list[str]:
    """Names of the files that a COLMAP model needs, of the kind of which fewer are missing."""
    kinds = [[f for name in MODEL_FILES if not (model_folder / (f := f"{name}.{k}")).is_file()] for k in ("bin", "txt")]
    return min(kinds, key=len)


def _read_colmap(model_folder: Path) -> Any:
    missing = _missing(model_folder)
    if missing:
        raise InputError(f"{model_folder}: a COLMAP model without {missing[0]}; export it again")
    try:
        model = pycolmap.Reconstruction(model_folder)
    except Exception as error:  # COLMAP's own checks raise RuntimeError, ValueError and others
        reason = str(error).splitlines()[0]
        raise InputError(f"{model_folder}: cannot be read as a COLMAP model ({reason}); export it again") from None
    if model.num_reg_images() == 0:
        raise InputError(f"{model_folder}: holds no image with a pose; reconstruct it again")
    images = [model.image(i) for i in model.reg_image_ids()]
    for image in images:
        pose = image.cam_from_world()
        # COLMAP reads a quaternion of any length, and takes one of none for no rotation.
        if not (abs(np.linalg.norm(pose.rotation.quat) - 1) < 1e-3 and np.isfinite(pose.translation).all()):
            raise InputError(f"{model_folder}: the pose of {image.name} is not a rotation and a translation")
    for number in sorted({image.camera_id for image in images}):
        check_intrinsics(model.camera(number), f"{model_folder}: camera {number}")
    return model


def _image_folder(path: Path) -> Path:
    for name in IMAGE_FOLDERS:
        if (path / name).is_dir() and any(p.suffix.lower() in folder.EXTENSIONS for p in (path / name).rglob("*")):
            return path / name
    raise InputError(f"{path}: has a COLMAP model but no pictures; put them into {path / 'images'}")


def _inside(name: str, index: Path) -> PurePosixPath:
    relative = PurePosixPath(name)
    if relative.is_absolute() or ".." in relative.parts:
        raise InputError(f"{index}: names the picture {name!r}, which lies outside of the folder")
    return relative


def read_transforms(path: Path) -> Any:
    """A COLMAP reconstruction from nerfstudio's transforms.json (OpenGL axes, camera to world).

    Raises:
        InputError: a camera model or a value that is not understood; names the key.
    """
    document = read_json_object(path, "nerfstudio's cameras")
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f'{path}: key "frames" is missing or empty')
    model = pycolmap.Reconstruction()
    cameras: dict[tuple[Any, ...], int] = {}
    for number, frame in enumerate(frames, 1):
        try:
            values = {**document, **frame}
            key = _camera_values(values, path)
            matrix = np.array(frame["transform_matrix"], np.float64).reshape(4, 4)
            name = str(frame["file_path"])
        except KeyError as error:
            raise InputError(f"{path}: key {error} is missing, for frame {number - 1}; export it again") from None
        except (TypeError, ValueError) as error:
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
        image = pycolmap.Image(name=name.removeprefix("./"), camera_id=cameras[key], image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(viewmat[:3]))
    return model


def _camera_values(values: dict[str, Any], path: Path) -> tuple[Any, ...]:
    """COLMAP's name of the model, width, height and parameters."""
    kind = values.get("camera_model", "OPENCV")
    width, height = int(values["w"]), int(values["h"])
    if "camera_angle_x" in values and "fl_x" not in values:
        fx = 0.5 * width / float(np.tan(0.5 * float(values["camera_angle_x"])))
    else:
        fx = float(values["fl_x"])
    fy = float(values.get("fl_y", fx))
    center = float(values.get("cx", width / 2)), float(values.get("cy", height / 2))
    distortion = [float(values.get(name, 0.0)) for name in ("k1", "k2", "p1", "p2")]
    if kind not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE"):
        raise InputError(f'{path}: camera_model {kind!r} is not supported; expected "OPENCV" or "PINHOLE"')
    if not any(distortion) or kind != "OPENCV":
        return ("PINHOLE", width, height, fx, fy, *center)
    return ("OPENCV", width, height, fx, fy, *center, *distortion)

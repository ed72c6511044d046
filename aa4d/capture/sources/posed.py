"""Frames whose cameras are known already: a COLMAP folder, or a nerfstudio folder with transforms.json."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pycolmap

from aa4d.capture.annotations import read_annotations
from aa4d.capture.clip import Clip
from aa4d.capture.reader import frame_of_index
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source, folder
from aa4d.errors import InputError
from aa4d.files import read_json_object

MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
IMAGE_FOLDERS = ("images", "frames", "input", ".")
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class PosedPictures:
    """A COLMAP reconstruction whose images go by the pictures' labels; without points where the source has none."""

    model: Any
    world: str | None  # in words, where the world is kept as it is; None: nothing says how it stands
    is_metric: bool = False

    @property
    def has_points(self) -> bool:
        """Points that know which frames show them; some programs write their points without."""
        return any(p.track.length() > 1 for p in self.model.points3D.values())

    def of_clip(self, clip: Clip) -> Any:
        """A reconstruction of the clip's frames: cameras at the clip's size, images under its file names."""
        model = pycolmap.Reconstruction(self.model)
        by_label = {frame.label: frame.file for frame in clip.frames}
        for image_id in list(model.reg_image_ids()):
            image = model.image(image_id)
            if image.name in by_label:
                image.name = by_label[image.name]
            else:
                model.deregister_frame(image.frame_id)
        for camera in model.cameras.values():
            camera.rescale(clip.width, clip.height)
        return model


def recognises(path: Path) -> bool:
    return path.is_dir() and (_model_folder(path) is not None or (path / "transforms.json").is_file())


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """The pictures that the reconstruction names, in the order of their numbers.

    Of a folder with both kinds of cameras transforms.json is read: its world is upright, a COLMAP model's is arbitrary.
    """
    model_folder, transforms = _model_folder(path), path / "transforms.json"
    times_s: dict[str, float] = {}
    notes = []
    if transforms.is_file():
        index, root = transforms, path
        times_s, is_metric = _own_capture(path)
        posed = PosedPictures(read_transforms(index), "transforms.json, whose world is kept", is_metric)
        if model_folder is not None:
            notes.append(f"cameras are those of transforms.json; {model_folder.relative_to(path)} is not read")
    else:
        assert model_folder is not None
        index, root = model_folder, _image_folder(path)
        posed = PosedPictures(_read_colmap(index), None)
    names = [posed.model.image(i).name for i in posed.model.reg_image_ids()]
    files = {name: root / _inside(name, index) for name in names}
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
        picture = folder.picture_of(file, times_s.get(present[file], at / selection.source_fps), number)
        pictures.append(replace(picture, label=present[file]))
    read = None if annotations is None else read_annotations(annotations, numbers)
    beside = [*index.iterdir()] if index.is_dir() else [index, path / "capture.json"]
    sources = (*ordered, *(p for p in beside if p.is_file()))
    return Source("reconstruction", pictures, lambda: [p.time_s for p in pictures], sources, notes, read, posed)


def _own_capture(path: Path) -> tuple[dict[str, float], bool]:
    """Of a capture of ours (docs/formats.md): the seconds of its pictures, and whether its world is in metres."""
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
        if any((path / name / f"images.{kind}").is_file() for kind in ("bin", "txt")):
            return path / name
    return None


def _read_colmap(model_folder: Path) -> Any:
    try:
        model = pycolmap.Reconstruction(model_folder)
    except Exception as error:  # COLMAP's own checks raise RuntimeError, ValueError and others
        reason = str(error).splitlines()[0]
        raise InputError(f"{model_folder}: cannot be read as a COLMAP model ({reason}); export it again") from None
    if model.num_reg_images() == 0:
        raise InputError(f"{model_folder}: holds no image with a pose; reconstruct it again")
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
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3]) - 1) > 1e-3:
            raise InputError(f"{path}: transform_matrix of frame {number - 1} is not a rotation and a translation")
        if key not in cameras:
            kind, width, height, *parameters = key
            camera = pycolmap.Camera(model=kind, width=width, height=height, params=parameters)
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
    centre = float(values.get("cx", width / 2)), float(values.get("cy", height / 2))
    distortion = [float(values.get(name, 0.0)) for name in ("k1", "k2", "p1", "p2")]
    if kind not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE"):
        raise InputError(f'{path}: camera_model {kind!r} is not supported; expected "OPENCV" or "PINHOLE"')
    if not any(distortion) or kind != "OPENCV":
        return ("PINHOLE", width, height, fx, fy, *centre)
    return ("OPENCV", width, height, fx, fy, *centre, *distortion)

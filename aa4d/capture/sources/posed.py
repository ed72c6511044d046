"""Frames whose cameras are known already: a COLMAP folder, or a nerfstudio folder with transforms.json."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pycolmap

from aa4d.capture.annotations import read_annotations
from aa4d.capture.clip import Clip
from aa4d.capture.colmap_files import damaged
from aa4d.capture.intrinsics import check_intrinsics
from aa4d.capture.schema import frame_of_index
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source, folder
from aa4d.capture.sources.transforms import index_of, read_transforms
from aa4d.errors import InputError
from aa4d.files import read_json_object

MODEL_FOLDERS = ("sparse/*", "sparse", "colmap/sparse/*", ".")
IMAGE_FOLDERS = ("images", "frames", "input", ".")
MODEL_FILES = ("cameras", "images", "points3D")


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
    return path.is_dir() and bool(index_of(path) or _model_folders(path))


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """The pictures that the reconstruction names, in the order of their numbers.

    Of a folder with both kinds of cameras transforms.json is read: its world is upright, a COLMAP model's is arbitrary.
    """
    model_folders, transforms = _model_folders(path), index_of(path)
    times_s: dict[str, float] = {}
    notes: list[str] = []
    if transforms is not None:
        index, root = transforms, path
        times_s, is_metric = _own_capture(path)
        read = read_transforms(index)
        posed = PosedPictures(index, read.model, f"{index.name}, whose world is kept", is_metric)
        if times_s:
            notes += selection.ignored_fps("capture.json")
        else:
            times_s, about_times = _seconds(read.times, selection, index)
            notes += [*read.notes, *about_times]
        if model_folders:
            notes.append(f"cameras are those of {index.name}; {model_folders[0].relative_to(path)} is not read")
    else:
        root = _image_folder(path)
        index, model = _largest(model_folders, notes)
        posed = PosedPictures(index, model, None)
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
    in_names = folder.times_of(ordered, numbers, selection, notes if not times_s else [])
    if times_s:
        order = sorted(range(len(ordered)), key=lambda i: times_s.get(present[ordered[i]], in_names[i]))
        ordered, in_names = [ordered[i] for i in order], [in_names[i] for i in order]
        numbers = None if numbers is None else [numbers[i] for i in order]
    pictures = []
    for rank, file in enumerate(ordered):
        number = None if numbers is None else numbers[rank]
        picture = folder.picture_of(file, times_s.get(present[file], in_names[rank]), number)
        pictures.append(replace(picture, label=present[file]))
    boxes = None if annotations is None else read_annotations(annotations, numbers)
    beside = [*index.iterdir()] if index.is_dir() else [index, path / "capture.json"]
    sources = (*ordered, *(p for p in beside if p.is_file()))
    return Source("reconstruction", pictures, lambda: [p.time_s for p in pictures], sources, notes, boxes, posed)


def _seconds(times: dict[str, float], selection: Selection, index: Path) -> tuple[dict[str, float], list[str]]:
    """Seconds of pictures of which only order and spacing are known, as a share of the clip; and what to say of it.

    Raises:
        InputError: some pictures are of one time, as those of several cameras.
    """
    ordered = sorted(times, key=times.__getitem__)
    if len(set(times.values())) <= 1:
        return {}, ['"time" is the same for all frames: their names say when they were taken'] if len(times) > 1 else []
    for one, other in pairwise(ordered):
        if times[one] == times[other]:
            raise InputError(
                f'{index}: "time" of {one} and {other} is the same, {times[one]:g}; give the frames of one camera'
            )
    first, last = times[ordered[0]], times[ordered[-1]]
    seconds = (len(times) - 1) / selection.folder_fps
    note = (
        f'order and spacing of frames are those of "time" in {index.name}, which has no unit; '
        f"{selection.folder_fps:g} frames a second are taken for the mean (--fps)"
    )
    return {name: (time - first) / (last - first) * seconds for name, time in times.items()}, [note]


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


def _model_folders(path: Path) -> list[Path]:
    """The folders of COLMAP models of one reconstruction, which may have come apart into several."""
    for pattern in MODEL_FOLDERS:
        found = [path / pattern]
        if pattern.endswith("*"):
            numbered = [p for p in path.glob(pattern) if p.is_dir() and p.name.isdecimal()]
            found = sorted(numbered, key=lambda p: int(p.name))
        # Two of the three files: one that lacks a file is told so.
        if models := [folder for folder in found if len(_missing(folder)) <= 1]:
            return models
    return []


def _largest(model_folders: list[Path], notes: list[str]) -> tuple[Path, Any]:
    """The model with the most frames; the others are named in the notes. Raises InputError where none can be read."""
    models: dict[Path, Any] = {}
    failures: list[InputError] = []
    for model_folder in model_folders:
        try:
            models[model_folder] = _read_colmap(model_folder)
        except InputError as error:
            failures.append(error)
    if not models:
        raise failures[0]
    largest = max(models, key=lambda folder: models[folder].num_reg_images())
    others = [f"{folder.name} ({model.num_reg_images()})" for folder, model in models.items() if folder != largest]
    if others:
        frames = models[largest].num_reg_images()
        notes.append(
            f"of {len(models)} models the largest is used: {largest} ({frames} frames); not {', '.join(others)}"
        )
    notes += [f"not used: {error}" for error in failures]
    return largest, models[largest]


def _missing(model_folder: Path) -> list[str]:
    """Names of the files that a COLMAP model needs, of the kind of which fewer are missing."""
    kinds = [[f for name in MODEL_FILES if not (model_folder / (f := f"{name}.{k}")).is_file()] for k in ("bin", "txt")]
    return min(kinds, key=len)


def _read_colmap(model_folder: Path) -> Any:
    missing = _missing(model_folder)
    if missing:
        raise InputError(f"{model_folder}: a COLMAP model without {missing[0]}; export it again")
    if (name := damaged(model_folder)) is not None:
        raise InputError(f"{model_folder}: {name} is cut short or damaged; export it again")
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

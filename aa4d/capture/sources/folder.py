"""A folder of frames, or of photographs."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import pycolmap

from aa4d.capture.annotations import read_annotations
from aa4d.capture.clip import Picture
from aa4d.capture.colmap import quiet
from aa4d.capture.gnss import position_of_photograph
from aa4d.capture.pictures import EXTENSIONS, is_plain, read_picture
from aa4d.capture.selection import abbreviate, shown
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source
from aa4d.errors import InputError


def recognises(path: Path) -> bool:
    return path.is_dir()


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """Frames in the order of their numbers, or of their names where one has none.

    The number gives the time too, so that a gap in the numbers is a gap in time.
    """
    found = sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
    files = [p for p in found if p.suffix.lower() in EXTENSIONS]
    notes = []
    others = [shown(p) for p in found if p.suffix.lower() not in EXTENSIONS]
    if others:
        notes.append(f"{abbreviate(others)} left out: no picture")
    if not files:
        raise InputError(f"{path}: holds no picture ({', '.join(EXTENSIONS)}); give the folder that holds the frames")
    files, numbers = in_order(files)
    times = [i / selection.folder_fps for i in range(len(files))]
    if numbers is not None:
        times = [(n - numbers[0]) / selection.folder_fps for n in numbers]
    elif len(files) > 1:
        notes.append("file names without numbers: their alphabetical order is taken for that of time")
    pictures = [
        picture_of(file, time_s, None if numbers is None else numbers[i])
        for i, (file, time_s) in enumerate(zip(files, times, strict=True))
    ]
    read = None if annotations is None else read_annotations(annotations, numbers)
    focal_share = _focal_share(files[0])
    return Source("frames", pictures, lambda: times, tuple(files), notes, read, focal_share=focal_share)


def _focal_share(photograph: Path) -> float | None:
    """From EXIF. Read here, because frames that are made smaller lose it."""
    quiet()
    try:
        camera = pycolmap.infer_camera_from_image(photograph)
    except (RuntimeError, ValueError):  # no kind of picture that COLMAP reads
        return None
    known = camera is not None and camera.has_prior_focal_length
    return float(camera.mean_focal_length()) / max(camera.width, camera.height) if known else None


def picture_of(file: Path, time_s: float, number: int | None) -> Picture:
    return Picture(
        label=shown(file),
        time_s=time_s,
        number=number,
        load=partial(read_picture, file),
        original=file if is_plain(file) else None,
        position=position_of_photograph(file),
    )


def in_order(files: list[Path]) -> tuple[list[Path], list[int] | None]:
    """Files by the last number in their names, and those numbers; None where a name has none or one occurs twice."""
    found = [re.findall(r"\d+", file.stem) for file in files]
    if not all(found):
        return sorted(files, key=lambda p: p.name), None
    numbers = [int(digits[-1]) for digits in found]
    if len(set(numbers)) < len(numbers):
        return sorted(files, key=lambda p: p.name), None
    order = sorted(range(len(files)), key=numbers.__getitem__)
    return [files[i] for i in order], [numbers[i] for i in order]

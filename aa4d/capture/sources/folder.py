"""A folder of frames, or of photographs."""

from __future__ import annotations

import re
from collections import Counter
from datetime import datetime
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path

import pycolmap
from PIL import Image

from aa4d.capture.annotations import read_annotations
from aa4d.capture.clip import Picture
from aa4d.capture.colmap import quiet
from aa4d.capture.gnss import position_of_photograph
from aa4d.capture.pictures import EXTENSIONS, is_plain, read_picture
from aa4d.capture.selection import abbreviate, shown
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source
from aa4d.errors import InputError

EXIF_OF_PHOTOGRAPH = 0x8769
DATE_TIME_ORIGINAL = 0x9003
MAKE_AND_MODEL = (0x010F, 0x0110)
FOCAL_LENGTHS = (0x920A, 0xA405)  # in mm, and in those of 35-mm film
SAME_FOCAL = 0.02  # share by which focal lengths of one lens differ at most, as it is focused
SUBSECOND_ORIGINAL = 0x9291


def recognises(path: Path) -> bool:
    return path.is_dir()


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """Frames in the order of their numbers, or of their names where one has none, unless EXIF knows better."""
    found = sorted(p for p in path.iterdir() if not (p.is_dir() or p.name.startswith(".")))
    files = [p for p in found if p.is_file() and p.suffix.lower() in EXTENSIONS]
    notes = []
    others = [shown(p) for p in found if p not in files]
    if others:
        notes.append(f"{abbreviate(others)} left out: no picture")
    if not files:
        raise InputError(f"{path}: holds no picture ({', '.join(EXTENSIONS)}); give the folder that holds the frames")
    files, focal_share = of_one_lens(files, notes)
    files, numbers = in_order(files)
    times = times_of(files, numbers, selection, notes)
    pictures = [
        picture_of(file, time_s, None if numbers is None else numbers[i])
        for i, (file, time_s) in enumerate(zip(files, times, strict=True))
    ]
    read = None if annotations is None else read_annotations(annotations, numbers)
    return Source("frames", pictures, lambda: times, tuple(files), notes, read, focal_share=focal_share)


def of_one_lens(files: list[Path], notes: list[str]) -> tuple[list[Path], float | None]:
    """The files without those of which EXIF states another focal length than of most, which `notes` name.

    And that focal length over the longest side; None where EXIF says nothing.
    """
    lenses = [_lens(file) for file in files]
    shares = {lens: _focal_share(files[lenses.index(lens)]) for lens in set(lenses) - {None}}
    stated = [shares.get(lens) for lens in lenses]
    usual, _ = Counter(share for share in stated if share is not None).most_common(1)[0] if any(stated) else (None, 0)
    others = [i for i, share in enumerate(stated) if share and usual and abs(share / usual - 1) > SAME_FOCAL]
    if others:
        names = abbreviate([shown(files[i]) for i in others])
        notes.append(f"{names} left out: EXIF's focal length is not that of most")
    return [file for i, file in enumerate(files) if i not in others], usual


def _lens(photograph: Path) -> tuple[str, ...] | None:
    """The camera and its focal length by EXIF; None where EXIF says nothing of the latter."""
    try:
        with Image.open(photograph) as image:
            exif = image.getexif()
        inner = exif.get_ifd(EXIF_OF_PHOTOGRAPH)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return None
    lengths = [inner.get(tag) for tag in FOCAL_LENGTHS]
    if not any(lengths):
        return None
    return tuple(str(value) for value in (*(exif.get(tag) for tag in MAKE_AND_MODEL), *lengths, *image.size))


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
    """Files in the order of time, and the last number in each one's name; None where one has none or one occurs twice.

    That is the order of the numbers, or else of the names. Where EXIF says of all files when they were taken, and that
    some of higher numbers came earlier, a counter has begun anew, and EXIF's order is right.
    """
    found = [re.findall(r"\d+", file.stem) for file in files]
    numbers = [int(digits[-1]) for digits in found if digits]
    if len(set(numbers)) < len(files):
        return sorted(files, key=lambda p: p.name), None
    order = sorted(range(len(files)), key=numbers.__getitem__)
    taken = taken_s([files[i] for i in order])
    if taken is not None and any(after < before for before, after in pairwise(taken)):
        order = _unrolled(order, taken)
    return [files[i] for i in order], [numbers[i] for i in order]


def _unrolled(order: list[int], taken: list[float]) -> list[int]:
    """In the order of EXIF; those of one second as they were, but for a counter that began anew in it."""
    falls = [i for i in range(1, len(taken)) if taken[i] < taken[i - 1]]
    if len(falls) == 1 and taken[-1] <= taken[0]:
        return order[falls[0] :] + order[: falls[0]]
    return [order[i] for i in sorted(range(len(order)), key=taken.__getitem__)]


def times_of(files: list[Path], numbers: list[int] | None, selection: Selection, notes: list[str]) -> list[float]:
    """Seconds of files in order, from 0: EXIF's, or by number, so that a gap in the numbers is one in time.

    What is said of it is added to `notes`. A stated --fps holds whatever EXIF says of the seconds.
    """
    if len(files) < 2:
        return [0.0] * len(files)
    has_begun_anew = numbers is not None and any(after < before for before, after in pairwise(numbers))
    if has_begun_anew:
        notes.append("the counter in the file names begins anew: frames are in the order of EXIF's times")
    taken = taken_s(files)
    if taken is not None and selection.source_fps is None and taken[0] < taken[-1]:
        notes.append("times are EXIF's, when the photographs were taken; --fps states another rate")
        return _spread(taken)
    if numbers is None:
        notes.append("the file names do not number the frames: their alphabetical order is taken for that of time")
    if numbers is None or has_begun_anew:
        return [i / selection.folder_fps for i in range(len(files))]
    return [(n - numbers[0]) / selection.folder_fps for n in numbers]


def taken_s(files: list[Path]) -> list[float] | None:
    """When photographs were taken, seconds by their own clock; None where EXIF does not say so of all."""
    times = []
    for file in files:
        try:
            with Image.open(file) as image:
                exif = image.getexif().get_ifd(EXIF_OF_PHOTOGRAPH)
            moment = datetime.strptime(str(exif[DATE_TIME_ORIGINAL]).strip("\0 "), "%Y:%m:%d %H:%M:%S")
            share = str(exif.get(SUBSECOND_ORIGINAL, "")).strip("\0 ")
        except (OSError, SyntaxError, ValueError, KeyError, Image.DecompressionBombError):
            return None
        times.append(
            (moment - datetime(1970, 1, 1)).total_seconds() + (float(f"0.{share}") if share.isdecimal() else 0)
        )
    return times


def _spread(taken: list[float]) -> list[float]:
    """Seconds from 0, rising: photographs of one second are spread evenly until the next, at most over that second."""
    ordered = sorted(taken)
    seconds: list[float] = []
    for moment, group in groupby(ordered):
        count = len(list(group))
        later = ordered[len(seconds) + count] if len(seconds) + count < len(ordered) else moment + 1
        seconds += [moment - ordered[0] + i * min(later - moment, 1.0) / count for i in range(count)]
    return seconds

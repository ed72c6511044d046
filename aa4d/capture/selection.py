"""From a source's pictures to the clip: range, rate, one size, neither blurred nor repeated."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Clip, ClipFrame, Picture
from aa4d.capture.pictures import save_png
from aa4d.capture.settings import Selection
from aa4d.capture.workspace import Progress
from aa4d.errors import InputError

SHARPNESS_PX = 640  # sharpness and repetition are judged on pictures of that width
THUMBNAIL = (64, 36)
NEIGHBOURS = 5  # sharpness is compared with the median of so many frames to each side
FEWEST = 3  # frames, for a reconstruction


@dataclass(frozen=True)
class Candidate:
    picture: Picture
    size: tuple[int, int]  # width and height in the source
    file: str
    sharpness: float
    thumbnail: NDArray[np.float32]


def sharpness(pixels: NDArray[np.uint8]) -> float:
    """Variance of the Laplacian over that of the grey values: a change of exposure does not count as blur."""
    scale = min(1.0, SHARPNESS_PX / pixels.shape[1])
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
    return float(cv2.Laplacian(grey, cv2.CV_32F).var() / max(float(grey.var()), 1.0))


def thumbnail(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.resize(grey, THUMBNAIL, interpolation=cv2.INTER_AREA), np.float32)


def make_clip(
    pictures: Iterable[Picture],
    duration_s: float | None,
    selection: Selection,
    notes: list[str],
    folder: Path,
    progress: Progress,
) -> Clip:
    """Write the frames that are used into `folder`.

    Args:
        pictures: in presentation order; `duration_s` is that of the last, where it is known beforehand.
        notes: what the source has left out; what is left out here is added.

    Raises:
        InputError: fewer than three frames are left.
    """
    end = selection.end_s if selection.end_s is not None else duration_s
    rate = selection.rate
    if rate is None and end is not None and end > selection.start_s:
        # A hair over, so that a clip of exactly that many frames keeps them all.
        rate = (selection.max_frames - 1) / (end - selection.start_s) * 1.0001
    total = None if rate is None or end is None else int((end - selection.start_s) * rate) + 1
    kept: list[Candidate] = []
    for done, candidate in enumerate(_sharpest(_in_range(pictures, selection), rate, selection, folder, notes), 1):
        if len(kept) >= selection.max_frames:
            (folder / candidate.file).unlink()
            notes.append(f"the clip was cut at {selection.max_frames} frames (--max-frames)")
            break
        kept.append(candidate)
        progress(done, total)
    for reason, rejected in (
        ("of another size than most", _other_sizes(kept)),
        ("repeat the frame before", _repeated(kept, selection.duplicate_below)),
        ("blurred", _blurred(kept, selection.blurred_below)),
    ):
        _reject(kept, rejected, reason, folder, notes)
    if len(kept) < FEWEST:
        if not kept and duration_s is not None and selection.start_s > duration_s:
            raise InputError(f"--start {selection.start_s:g}: the input ends before (at {duration_s:.1f} s); give less")
        raise InputError(_too_few(kept, notes))
    width, height = _size_of(folder / kept[0].file)
    frames = tuple(
        ClipFrame(c.file, c.picture.label, c.picture.time_s, c.picture.number, c.sharpness, c.picture.position)
        for c in kept
    )
    return Clip(folder, width, height, kept[0].size, frames, tuple(notes))


def _in_range(pictures: Iterable[Picture], selection: Selection) -> Iterator[Picture]:
    for picture in pictures:
        if selection.end_s is not None and picture.time_s > selection.end_s:
            return
        if picture.time_s >= selection.start_s:
            yield picture


def _sharpest(
    pictures: Iterable[Picture], rate: float | None, selection: Selection, folder: Path, notes: list[str]
) -> Iterator[Candidate]:
    """Of the pictures that fall to one tick of the rate, the sharpest; all pictures where there is no rate."""
    best: tuple[float, Picture, NDArray[np.uint8]] | None = None
    tick, written = None, 0
    for picture in pictures:
        this = written if rate is None else int((picture.time_s - selection.start_s) * rate)
        try:
            pixels = picture.load()
        except InputError as error:
            notes.append(f"{picture.label} left out: {error}")
            continue
        sharp = sharpness(pixels)
        if best is not None and (rate is None or this != tick):
            yield _write(best, written, selection, folder)
            written, best = written + 1, None
        if best is None or sharp > best[0]:
            best = (sharp, picture, pixels)
        tick = this
    if best is not None:
        yield _write(best, written, selection, folder)


def _write(
    best: tuple[float, Picture, NDArray[np.uint8]], number: int, selection: Selection, folder: Path
) -> Candidate:
    sharp, picture, pixels = best
    height, width = pixels.shape[:2]
    longest = max(width, height)
    if longest > selection.longest_px:
        scale = selection.longest_px / longest
        size = (round(width * scale), round(height * scale))
        resized = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
        file = save_png(folder / f"{number:06}.png", resized).name
    elif picture.original is not None:
        file = f"{number:06}{picture.original.suffix.lower()}"
        shutil.copyfile(picture.original, folder / file)
    else:
        file = save_png(folder / f"{number:06}.png", pixels).name
    return Candidate(picture, (width, height), file, sharp, thumbnail(pixels))


def _other_sizes(kept: list[Candidate]) -> list[int]:
    if not kept:
        return []
    usual = Counter(c.size for c in kept).most_common(1)[0][0]
    return [i for i, c in enumerate(kept) if c.size != usual]


def _repeated(kept: list[Candidate], below: float) -> list[int]:
    """Against the last frame that was kept, so that slow drift is not mistaken for standstill."""
    rejected, last = [], None
    for i, candidate in enumerate(kept):
        if last is not None and float(np.abs(candidate.thumbnail - last).mean()) <= below:
            rejected.append(i)
        else:
            last = candidate.thumbnail
    return rejected


def _blurred(kept: list[Candidate], below: float) -> list[int]:
    values = np.array([c.sharpness for c in kept])
    rejected = []
    for i, value in enumerate(values):
        around = np.delete(values[max(i - NEIGHBOURS, 0) : i + NEIGHBOURS + 1], min(i, NEIGHBOURS))
        if len(around) and value < below * float(np.median(around)):
            rejected.append(i)
    return rejected


def _reject(kept: list[Candidate], rejected: list[int], reason: str, folder: Path, notes: list[str]) -> None:
    if not rejected:
        return
    labels = [kept[i].picture.label for i in rejected]
    notes.append(f"{some(labels)} left out: {reason}")
    for i in reversed(rejected):
        (folder / kept.pop(i).file).unlink()


def some(labels: list[str]) -> str:
    """A few names of many."""
    if len(labels) <= 4:
        return ", ".join(labels)
    return f"{len(labels)} frames ({labels[0]}, {labels[1]}, ... {labels[-1]})"


def _size_of(path: Path) -> tuple[int, int]:
    from PIL import Image

    with Image.open(path) as image:
        return image.size


def _too_few(kept: list[Candidate], notes: list[str]) -> str:
    reasons = "; ".join(notes if len(notes) <= 3 else [*notes[:2], f"and {len(notes) - 2} more notes"])
    found = f"{len(kept)} usable frame{'' if len(kept) == 1 else 's'}"
    advice = "give a longer clip, a higher --rate, or a range (--start, --end) in which the drone moves"
    return f"{found}, and at least {FEWEST} are needed{f' ({reasons})' if reasons else ''}; {advice}"

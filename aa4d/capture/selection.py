"""From a source's pictures to the clip: range, rate, one size, neither blurred nor repeated."""

from __future__ import annotations

import os
import shutil
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Clip, ClipFrame, Picture
from aa4d.capture.overlay import overlay_note
from aa4d.capture.pictures import save_png
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source
from aa4d.capture.workspace import Progress, Step
from aa4d.errors import InputError

SHARPNESS_PX = 640  # sharpness and repetition are judged on pictures of that width
THUMBNAIL = (64, 36)
NEIGHBOURS = 5  # sharpness is compared with the median of so many frames to each side
MAX_ASPECT_RATIO = 20  # beyond, smaller pictures would have no pixel across
MOST_NOTES = 3  # of one kind
MIN_FRAMES = 3  # for a reconstruction


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


def frames_step(source: Source, selection: Selection) -> Step[Clip]:
    def run(folder: Path, progress: Progress) -> Clip:
        for leftover in folder.glob("*.*g"):
            leftover.unlink()
        return make_clip(source.pictures, source.times_s(), selection, source.notes, folder, progress)

    return Step("frames", [source.stamps(), asdict(selection)], run, Clip)


def make_clip(
    pictures: Iterable[Picture],
    times_s: list[float],
    selection: Selection,
    notes: list[str],
    folder: Path,
    progress: Progress,
) -> Clip:
    """Write the frames that are used into `folder`.

    Args:
        pictures: in presentation order, shown at `times_s`.
        notes: what the source has left out; what is left out here is added.

    Raises:
        InputError: fewer than three frames are left.
    """
    within = [t for t in times_s if is_within(t, selection)]
    if not within:
        raise InputError(
            f"no frame lies between --start and --end: the input's are shown from {times_s[0]:.2f} s to "
            f"{times_s[-1]:.2f} s; choose a range in there"
        )
    tick_of = _ticks(within, selection)
    total = min(len({tick_of(t) for t in within}), selection.most_frames)
    kept: list[Candidate] = []
    for done, candidate in enumerate(_sharpest(pictures, tick_of, selection, folder, notes), 1):
        if len(kept) >= selection.most_frames:
            (folder / candidate.file).unlink()
            notes.append(f"the clip was cut at {selection.most_frames} frames (--max-frames)")
            break
        kept.append(candidate)
        progress(done, total)
    _reject(kept, _other_sizes(kept), "of another size than most", folder, notes)
    _reject(kept, _repeated(kept, selection.duplicate_below), "repeat the frame before", folder, notes)
    _reject(kept, _copies(kept), "copies of an earlier frame", folder, notes)
    _reject(kept, _blurred(kept, selection.blurred_below), "blurred", folder, notes)
    if len(kept) < MIN_FRAMES:
        raise InputError(_too_few(kept, notes))
    if (note := overlay_note([folder / c.file for c in kept])) is not None:
        notes.append(note)
    width, height = _size_of(folder / kept[0].file)
    frames = tuple(
        ClipFrame(c.file, c.picture.label, c.picture.time_s, c.picture.number, c.sharpness, c.picture.position)
        for c in kept
    )
    return Clip(folder, width, height, kept[0].size, frames, tuple(notes))


def is_within(time_s: float, selection: Selection) -> bool:
    return selection.start_s <= time_s and (selection.end_s is None or time_s <= selection.end_s)


def _ticks(within: list[float], selection: Selection) -> Callable[[float], int]:
    """The frame of the clip that a time falls to: by the rate, else so that `most_frames` are spread over all times."""
    rate = selection.rate
    if rate is not None:
        return lambda time_s: int((time_s - selection.start_s) * rate)
    # Found again by their rank: a video's decoder may round times otherwise than its index.
    return lambda time_s: bisect_left(within, time_s - 1e-6) * selection.most_frames // len(within)


def _sharpest(
    pictures: Iterable[Picture],
    tick_of: Callable[[float], int],
    selection: Selection,
    folder: Path,
    notes: list[str],
) -> Iterator[Candidate]:
    """The sharpest of the pictures in range that fall to one tick."""
    best: tuple[float, Picture, NDArray[np.uint8]] | None = None
    tick, written = None, 0
    damaged: list[tuple[str, str]] = []
    for picture in pictures:
        if not is_within(picture.time_s, selection):
            if picture.time_s < selection.start_s:
                continue
            break
        this = tick_of(picture.time_s)
        try:
            pixels = picture.load()
            if max(pixels.shape[:2]) > MAX_ASPECT_RATIO * min(pixels.shape[:2]):
                raise InputError(f"{pixels.shape[1]}x{pixels.shape[0]} pixels are no frame of a camera")
        except InputError as error:
            damaged.append((picture.label, str(error)))
            continue
        sharp = sharpness(pixels)
        if best is not None and this != tick:
            yield _write(best, written, selection, folder)
            written, best = written + 1, None
        if best is None or sharp > best[0]:
            best = (sharp, picture, pixels)
        tick = this
    notes += told(damaged)
    if best is not None:
        yield _write(best, written, selection, folder)


def told(damaged: list[tuple[str, str]]) -> list[str]:
    """Notes on pictures that were left out, each a label and the reason: one by one, or of many the first's reason."""
    if len(damaged) <= MOST_NOTES:
        return [f"{label} left out: {reason}" for label, reason in damaged]
    return [f"{abbreviate([label for label, _ in damaged])} left out, the first because: {damaged[0][1]}"]


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


def _copies(kept: list[Candidate]) -> list[int]:
    """The same pictures once more, as in a folder with copies under other names: the clip would play twice."""
    first: dict[bytes, int] = {}
    return [i for i, candidate in enumerate(kept) if first.setdefault(candidate.thumbnail.tobytes(), i) != i]


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
    notes.append(f"{abbreviate(labels)} left out: {reason}")
    for i in reversed(rejected):
        (folder / kept.pop(i).file).unlink()


def shown(path: Path) -> str:
    """A file's name as text that can be stored and shown: on some systems names are any bytes."""
    return os.fsencode(path.name).decode("utf-8", errors="backslashreplace")


def abbreviate(labels: list[str]) -> str:
    """The names, or a few of many."""
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
    return f"{found}, and at least {MIN_FRAMES} are needed{f' ({reasons})' if reasons else ''}; {advice}"

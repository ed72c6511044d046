"""Spacing of the frames used: a mover is followed from one to the next, so it must not travel too far.

What a mover travels is measured in its own lengths, which needs no scale: beyond about half a length it lies nearer to
where its neighbour was than to where it was itself. It is measured on frames of the source that follow each other
closely, at a few places of the clip, as its motion beside the background's (movers.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.advice import Advice
from aa4d.capture.movers import (
    DISAGREEMENT_PX,
    MAX_MOVING_FRACTION,
    Floats,
    beside_background,
    fine_flow,
    no_guess,
    rough_flow,
    without_specks,
)
from aa4d.capture.selection import is_within
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source
from aa4d.capture.workspace import Progress, Step, StepResult
from aa4d.errors import InputError

LENGTHS = 0.5  # own lengths that a mover may travel from one frame used to the next
MAX_LENGTHS = 0.75  # beyond, it is told that movers cannot be followed
LOOKS = 6  # places of the clip
GAPS_S = (0.1, 0.3)  # between the frames compared; the second where the first shows too little
MIN_SEEN = 5  # movers, over all places: with fewer, nothing is said
PACE_PERCENTILE = 75  # a few fast movers do not decide
LONGEST_PX = 960  # longest side of the pictures in which motion is measured
MAX_ENLARGEMENT = 2.0
ASYMMETRY = 0.35  # fraction of its speed, between a mover's motion before and after
SAME_MOTION = 0.4  # fraction of its speed, by which the motion of a mover's pixels may differ
STEADY = 0.2  # the same for the median pixel of what first showed it
FILLED = 0.5  # fraction of the rectangle around a mover: what is thinner is an outline or the rim of a house
BORDER_PX = 2
SPILL = 1.25  # flow reaches over outlines: movers come out longer by about that (docs/capture.md)

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Pace:
    """Speed of the movers, and the frames that the source has to follow them by."""

    lengths_per_s: float  # own lengths, by a fast mover
    step_s: float  # from a frame of the source to the next
    first_s: float  # bounds of the source's range
    last_s: float


@dataclass(frozen=True)
class Spacing(StepResult):
    pace: Pace | None  # None where it cannot be told
    end_s: float | None  # end of the selection
    notes: tuple[str, ...]

    @classmethod
    def from_json(cls, folder: Path, value: dict[str, Any]) -> Self:
        pace = value["pace"]
        return cls(folder, Pace(**pace) if pace else None, value["end_s"], tuple(value["notes"]))


def spacing_step(source: Source, selection: Selection) -> Step[Spacing]:
    return Step(
        "spacing",
        [source.stamps(), selection.start_s, selection.end_s, selection.folder_fps, selection.is_open],
        lambda folder, progress: choose_spacing(source, selection, folder, progress),
        Spacing,
    )


def choose_spacing(source: Source, selection: Selection, folder: Path, progress: Progress) -> Spacing:
    """Measure the movers' pace, and end the clip where they could no longer be followed.

    Where nobody has said which frames to use, it ends where so many as are used at most lie close enough together.
    Nothing is taken from `source.pictures`, and nothing is written into `folder`.
    """
    times = [t for t in source.times_s() if is_within(t, selection)]
    paces = _paces(source, times, progress)
    if len(paces) < MIN_SEEN:
        return Spacing(folder, None, selection.end_s, ())
    pace = Pace(float(np.percentile(paces, PACE_PERCENTILE)), _step_of(times), times[0], times[-1])
    end_s, notes = followable_until(pace, times, selection)
    return Spacing(folder, pace, end_s, tuple(notes))


def followable_until(pace: Pace, times: list[float], selection: Selection) -> tuple[float | None, list[str]]:
    """The second at which the clip ends so that movers can be followed, and what there is to say of it.

    Args:
        times: of the source's frames in the range.
    """
    stride, most = _stride(pace), selection.most_frames
    if not selection.is_open or pace.lengths_per_s * pace.step_s > MAX_LENGTHS or len(times) <= stride * most:
        return selection.end_s, []
    end_s = times[stride * most - 1] + 0.5 * pace.step_s  # a decoder may round times otherwise than its index
    note = (
        f"movers travel about {pace.lengths_per_s:.1f} of their own lengths a second: so that they can be followed, "
        f"{most} frames {stride * pace.step_s:.2f} s apart are used, until {end_s:.1f} s of {pace.last_s:.1f} s; "
        "--start, --end, --rate and --max-frames choose others"
    )
    return end_s, [note]


def spacing_advice(pace: Pace, used_s: list[float], most_frames: int) -> list[Advice]:
    """Advice where movers travel too far between the frames used, which are shown at `used_s`."""
    lengths = pace.lengths_per_s * _step_of(used_s)
    if lengths <= MAX_LENGTHS:
        return []
    between = pace.lengths_per_s * pace.step_s
    if between > MAX_LENGTHS:
        said = (
            f"Movers travel {lengths:.1f} of their own length between the frames used, and {between:.1f} between "
            "successive frames of the input: they cannot be followed. Give "
            f"{math.ceil(pace.lengths_per_s / LENGTHS)} frames a second or more of the flight."
        )
        return [Advice(said)]
    rate = math.ceil(10 / (_stride(pace) * pace.step_s)) / 10
    end_s = pace.first_s + most_frames / rate
    until = f" --end {math.ceil(10 * end_s) / 10:g}" if end_s < pace.last_s else ""
    said = (
        f"Movers travel {lengths:.1f} of their own length between the frames used, too far to be followed from one to "
        f"the next: use --rate {rate:g}{until}."
    )
    return [Advice(said)]


def _stride(pace: Pace) -> int:
    """Frames of the source from one frame used to the next."""
    return max(int(LENGTHS / (pace.lengths_per_s * pace.step_s) + 1e-6), 1)


def _step_of(times: list[float]) -> float:
    """Seconds from a frame to the next, as a rule."""
    return max(float(np.median(np.diff(times))), 1e-6)


def _paces(source: Source, times: list[float], progress: Progress) -> list[float]:
    """Lengths a second of the movers at some places of the clip."""
    found: list[float] = []
    for attempt, gap_s in enumerate(GAPS_S):
        stride = max(round(gap_s / _step_of(times)), 1) if len(times) > 1 else 1
        if len(times) < 2 * stride + 1 or len(found) >= MIN_SEEN:
            break
        places = np.unique(np.linspace(stride, len(times) - 1 - stride, LOOKS).astype(int))
        found = []
        for done, place in enumerate(places, 1):
            found += _paces_at(source, times, int(place), stride)
            progress(attempt * len(places) + done, (attempt + 1) * len(places))
    return found


def _paces_at(source: Source, times: list[float], place: int, stride: int) -> list[float]:
    """Lengths a second of every mover in the frame `place`, by those `stride` before and after."""
    first = times[place - stride] - 0.5 * _step_of(times)
    wanted = {0: 0, stride: 1, 2 * stride: 2}
    found: list[tuple[float, Picture]] = []
    try:
        for rank, picture in enumerate(p for p in source.pictures_from(first) if p.time_s >= first):
            if rank in wanted:
                found.append((picture.time_s, _grey(picture.load())))
            if len(found) == len(wanted):
                break
    except InputError:
        return []  # a damaged frame; choosing the frames says so
    if len(found) < len(wanted) or len({grey.shape for _, grey in found}) > 1:
        return []
    (from_s, before), (_, here), (to_s, after) = found
    return (
        [2 * lengths / (to_s - from_s) for lengths in lengths_travelled(before, here, after)] if to_s > from_s else []
    )


def _grey(pixels: Picture) -> Picture:
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    scale = min(LONGEST_PX / max(grey.shape), MAX_ENLARGEMENT)
    kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=kind), np.uint8)


def lengths_travelled(before: Picture, here: Picture, after: Picture) -> list[float]:
    """For every mover in `here` [H, W]: its way to either neighbour over its extent along that way."""

    def towards(there: Picture) -> tuple[Floats, Floats] | None:
        rough = np.asarray(rough_flow().calc(here, there, no_guess(here)), np.float32)
        return beside_background(here, there, rough, fine_flow())

    earlier, later = towards(before), towards(after)
    if earlier is None or later is None:
        return []
    (away_before, back), (away_after, forth) = earlier, later
    away = np.minimum(away_before, away_after)
    if (away > DISAGREEMENT_PX).mean() > MAX_MOVING_FRACTION:
        return []  # the background was not found
    motion = 0.5 * (forth - back)
    speed = np.linalg.norm(motion, axis=2)
    steady = np.linalg.norm(forth + back, axis=2) < ASYMMETRY * speed
    moving = (cv2.GaussianBlur(away, (0, 0), 1.0) > DISAGREEMENT_PX) & steady
    return list(lengths_of(moving, motion))


def lengths_of(moving: NDArray[np.bool_], motion: NDArray[np.float32]) -> Iterator[float]:
    """Patches of `moving` [H, W], grown or cut to what shares their motion; what the edge cuts is no use."""
    count, labels = cv2.connectedComponents(without_specks(moving.astype(np.uint8)), connectivity=8)
    taken = np.zeros(moving.shape, bool)
    for label in range(1, count):
        patch = labels == label
        velocity = np.median(motion[patch], axis=0)
        speed = float(np.linalg.norm(velocity))
        off = np.linalg.norm(motion - velocity, axis=2)
        if float(np.median(off[patch])) > STEADY * speed:
            continue
        _, alike = cv2.connectedComponents((off < SAME_MOTION * speed).astype(np.uint8), connectivity=8)
        body = alike == np.bincount(alike[patch & (alike > 0)]).argmax()
        rows, columns = np.nonzero(body)
        near, far = (min(rows.min(), columns.min()), max(rows.max() - body.shape[0], columns.max() - body.shape[1]))
        if near < BORDER_PX or far >= -BORDER_PX or taken[body].mean() > 0.5:
            continue
        taken |= body
        ahead = velocity / speed
        along = _extent(columns * ahead[0] + rows * ahead[1])
        across = _extent(rows * ahead[0] - columns * ahead[1])
        if body.sum() >= FILLED * along * across:
            yield SPILL * speed / along


def _extent(places: NDArray[np.floating[Any]]) -> float:
    low, high = np.percentile(places, [2, 98])
    return max(float(high - low), 1.0)

"""Held-out frames on a page: sliders, loops, and where moving pixels are worst, of one run or of several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import instance_ids_of, moving_mask
from aa4d.errors import InputError
from aa4d.reports.page import Column, Loop, Part, Pictures, Section, Slider, Table, View
from aa4d.reports.pictures import (
    ERROR_GAIN,
    Detail,
    Pixels,
    cut_out,
    error_picture,
    loop_of,
    picture_of,
)
from aa4d.reports.scored import COARSE, DRAWN, ScoredRun

Window = tuple[int, int, int, int]  # left, top, right, bottom, pixels

TRUTH = "truth"
SMALLEST_PX = 20  # of what moves
SEARCHED = 16  # frames at most, in which the worst is looked for
WORST = 3  # vehicles that are shown
AROUND, LEAST_SHARE, ASPECT = 1.7, 0.1, 4 / 3  # of a cut-out: to its vehicle's longer side, of the frame's width
CUT_PX = 240
SECONDS = (0.2, 1.0)  # of a moment in a loop, least and most
LOOPED = 24  # frames at most


@dataclass(frozen=True)
class Drawn:
    """A run under the name that the page has for it."""

    title: str
    run: ScoredRun


@dataclass(frozen=True)
class Held:
    """A held-out frame: the truth where its capture is there, and what each run drew of it."""

    name: str
    t: float
    index: int | None  # in the capture
    pictures: tuple[Pixels | None, ...]  # truth first


def frame_sections(
    heading: str, capture: Capture | None, runs: Sequence[Drawn], detail: Detail, against: str | None = None
) -> list[Section]:
    """Sections on the held-out frames of a capture.

    Args:
        against: title of the run that the last one is slid over; None: the first picture, which is the truth where its
            capture is there.

    Raises:
        InputError: a picture or the truth is damaged, or is of another size.
    """
    scored = _ranked(runs)
    chosen = sorted(scored[: detail.views], key=lambda frame: frame[1])
    held = [_held(capture, runs, name, t) for name, t, _ in chosen]
    held = [frame for frame in held if any(p is not None for p in frame.pictures[1:])]
    parts: list[Part] = []
    names = _names(capture, runs)
    slider = _slider(held, names, runs, detail, against)
    if slider is not None:
        parts.append(slider)
    loop = _loop(capture, runs, detail)
    if loop is not None:
        parts.append(loop)
    count = len(runs[0].run.frames)
    fewer = f" The {len(held)} of {count} with the worst moving pixels." if len(held) < count and held else ""
    how = "Drag the divider, or move it with the arrow keys." if slider else ""
    sections = [Section(heading, parts, note=f"Frames that training never saw. {how}{fewer}")]
    if capture is not None:
        sections.append(_worst_section(capture, runs, [name for name, _, _ in scored[:SEARCHED]]))
    return sections


def _ranked(runs: Sequence[Drawn]) -> list[tuple[str, float, float]]:
    """Name, t and score of the frames that runs share, worst moving pixels first (of all, where nothing moves)."""
    found: dict[str, tuple[float, list[float]]] = {}
    for drawn in runs:
        for frame in drawn.run.frames:
            moving = frame.get("psnr_dynamic")
            # A frame without anything that moves comes after those with.
            score = 1000.0 + frame["psnr"] if moving is None else moving
            found.setdefault(frame["frame"], (frame["t"], []))[1].append(score)
    means = [(name, t, sum(scores) / len(scores)) for name, (t, scores) in found.items()]
    return sorted(means, key=lambda entry: entry[2])


def _names(capture: Capture | None, runs: Sequence[Drawn]) -> tuple[str, ...]:
    """Of the pictures of a frame, the coarse stage's last where there is one run."""
    first = () if capture is None else (TRUTH,)
    return (*first, *(drawn.title for drawn in runs), *(("coarse stage",) if len(runs) == 1 else ()))


def _held(capture: Capture | None, runs: Sequence[Drawn], name: str, t: float) -> Held:
    index = truth = None
    if capture is not None:
        index = next((n for n, frame in enumerate(capture.frames) if frame.name == name), None)
        truth = None if index is None else read_image(capture, capture.frames[index])
    drawn = [d.run.drawn(name) for d in runs]
    shape = next((p.shape for p in (truth, *drawn) if p is not None), None)
    for run, picture in zip(runs, drawn, strict=True):
        if picture is not None and picture.shape != shape:
            path = run.run.folder / DRAWN / f"{name}.png"
            raise InputError(f"{path}: has another size than the frame; run `aa4d eval {run.run.trained}` again")
    return Held(name, t, index, (truth, *drawn))


def _slider(
    held: Sequence[Held], names: tuple[str, ...], runs: Sequence[Drawn], detail: Detail, against: str | None
) -> Slider | None:
    views = []
    for frame in held:
        pictures = list(frame.pictures if TRUTH in names[:1] else frame.pictures[1:])
        if len(runs) == 1:
            pictures.append(runs[0].run.drawn(frame.name, COARSE))
        encoded = tuple(
            None if p is None else picture_of(p, detail, f"{name}, frame {frame.name}")
            for name, p in zip(names, pictures, strict=True)
        )
        views.append(View(f"{frame.name}, t = {frame.t:.2f}", encoded, _note(frame.name, runs)))
    if len(runs) == 1 and not any(view.pictures[-1] for view in views):  # the coarse stage was not drawn
        names = names[:-1]
        views = [View(view.name, view.pictures[:-1], view.note) for view in views]
    if not views or len(names) < 2:
        return None
    left = names.index(against) if against in names[:-1] else 0
    return Slider(names, tuple(views), left, 1 if len(runs) == 1 else len(names) - 1)


def _note(name: str, runs: Sequence[Drawn]) -> str:
    """PSNR of a frame by each run, and of its moving pixels."""
    said = []
    for drawn in runs:
        score = next((f for f in drawn.run.frames if f["frame"] == name), None)
        if score is not None:
            moving = score.get("psnr_dynamic")
            of_run = "" if len(runs) == 1 else f"{drawn.title} "
            said.append(f"{of_run}{score['psnr']:.1f}" + ("" if moving is None else f" ({moving:.1f})"))
    return f"PSNR in dB, in brackets that of moving pixels: {', '.join(said)}."


def _loop(capture: Capture | None, runs: Sequence[Drawn], detail: Detail) -> Loop | None:
    """Held-out frames one after the other, the truth and every run beside each other."""
    frames = runs[0].run.frames
    step = -(-len(frames) // LOOPED)
    held = [_held(capture, runs, f["frame"], f["t"]) for f in frames[::step]]
    first = 0 if held and all(h.pictures[0] is not None for h in held) else 1
    here = [n for n in range(first, len(runs) + 1) if all(h.pictures[n] is not None for h in held)]
    if len(held) < 2 or not any(here) or len(here) < 1:
        return None
    names = tuple(TRUTH if n == 0 else runs[n - 1].title for n in here)
    moments = [[p for n in here if (p := h.pictures[n]) is not None] for h in held]
    columns = _columns(len(here))
    clip_s = _seconds(capture, held)
    moving, still = loop_of(moments, clip_s, columns, detail, f"held-out frames in order of time: {', '.join(names)}")
    which = "All held-out frames" if step == 1 else f"One in {step} of the held-out frames"
    return Loop(moving, still, names, columns, f"{which}, in order of time.")


def _columns(count: int) -> int:
    return count if count <= 3 else 2 if count == 4 else 3


def _seconds(capture: Capture | None, held: Sequence[Held]) -> list[float]:
    """How long each frame stands: as far apart as they were filmed, within `SECONDS`; the last as its neighbor."""
    if capture is None or any(h.index is None for h in held):
        return [0.4] * len(held)
    times = [capture.frames[h.index].time_s for h in held if h.index is not None]
    apart = [min(max(after - before, SECONDS[0]), SECONDS[1]) for before, after in pairwise(times)]
    return [*apart, apart[-1]]


@dataclass(frozen=True)
class Patch:
    """Something that moves in a frame, and how each run drew it."""

    frame: str
    name: str
    window: Window
    pixels: int
    psnr: tuple[float | None, ...]  # of the runs
    error: float  # mean square over its pixels and the runs


def worst_patches(capture: Capture, runs: Sequence[Drawn], names: Sequence[str], count: int) -> list[Patch]:
    """What moves and is drawn worst, the worst first; each instance once, in its worst frame."""
    found: list[Patch] = []
    by_name = {frame.name: index for index, frame in enumerate(capture.frames)}
    for name in (name for name in names if name in by_name):
        moving = moving_mask(capture, by_name[name])
        if moving is not None and moving.any():
            found += _patches(capture, by_name[name], moving, _held(capture, runs, name, 0.0))
    chosen: dict[str, Patch] = {}
    for patch in sorted(found, key=lambda patch: -patch.error):
        chosen.setdefault(patch.name, patch)
    return list(chosen.values())[:count]


def _patches(capture: Capture, index: int, moving: NDArray[np.bool_], held: Held) -> list[Patch]:
    truth = held.pictures[0]
    assert truth is not None
    errors = [
        None if p is None else ((p.astype(np.float64) - truth) ** 2).mean(axis=2) / 255**2 for p in held.pictures[1:]
    ]
    there = [error for error in errors if error is not None]
    if not there:
        return []
    ids = instance_ids_of(capture, index)
    labels = _connected(moving) if ids is None else np.where(moving, ids, 0)
    patches = []
    for label in np.unique(labels[labels > 0]).tolist():
        inside = labels == label
        pixels = int(inside.sum())
        if pixels < SMALLEST_PX:
            continue
        rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        means = [None if error is None else float(error[inside].mean()) for error in errors]
        psnr = tuple(None if m is None else -10 * math.log10(max(m, 1e-10)) for m in means)
        name = (
            f"patch {label} of {held.name}" if ids is None else capture.instance_names.get(label, f"instance {label}")
        )
        error = sum(m for m in means if m is not None) / len(there)
        patches.append(Patch(held.name, name, _window(box, truth.shape[1], truth.shape[0]), pixels, psnr, error))
    return patches


def _connected(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """A number from 1 on for each connected patch, 0 elsewhere."""
    from scipy import ndimage

    labels: NDArray[np.int32] = ndimage.label(mask)[0]
    return labels


def _window(box: Window, width: int, height: int) -> Window:
    """Around a box, moved into the frame."""
    longest = max(box[2] - box[0], (box[3] - box[1]) * ASPECT)
    across = min(max(round(AROUND * longest), round(LEAST_SHARE * width)), width, int(ASPECT * height))
    down = max(round(across / ASPECT), 1)
    left = min(max(round((box[0] + box[2] - across) / 2), 0), width - across)
    top = min(max(round((box[1] + box[3] - down) / 2), 0), height - down)
    return left, top, left + across, top + down


def _worst_section(capture: Capture, runs: Sequence[Drawn], names: Sequence[str]) -> Section:
    """What moves and is drawn worst, cut out: the truth, every run, and of a single one its error."""
    patches = worst_patches(capture, runs, names, WORST)
    columns = [Column("what moves", is_number=False), Column("frame", is_number=False), Column("pixels", 0)]
    columns += [Column(drawn.title if len(runs) > 1 else "PSNR, dB", 1, good=1) for drawn in runs]
    rows = [[patch.name, patch.frame, patch.pixels, *patch.psnr] for patch in patches]
    parts: list[Part] = [_cut_outs(patch, capture, runs) for patch in patches]
    title = f"Where moving pixels are worst: {capture.folder.resolve().name}"
    note = "Each mover once, in the held-out frame in which its pixels are drawn worst; decibels are over its pixels."
    return Section(title, [*parts, Table(columns, rows)] if patches else [], note)


def _cut_outs(patch: Patch, capture: Capture, runs: Sequence[Drawn]) -> Pictures:
    held, where = _held(capture, runs, patch.frame, 0.0), f"{patch.name}, frame {patch.frame}"
    truth = held.pictures[0]
    assert truth is not None
    found = [cut_out(truth, patch.window, CUT_PX, f"truth of {where}", f"{TRUTH}: {where}")]
    for drawn, picture, psnr in zip(runs, held.pictures[1:], patch.psnr, strict=True):
        if picture is None or psnr is None:
            continue
        found.append(cut_out(picture, patch.window, CUT_PX, f"{drawn.title}: {where}", f"{drawn.title}, {psnr:.1f} dB"))
        if len(runs) == 1:
            about = f"error, magnified {ERROR_GAIN} times"
            found.append(cut_out(error_picture(truth, picture), patch.window, CUT_PX, f"error of {where}", about))
    return Pictures(tuple(found), 3 if len(runs) == 1 else min(len(runs) + 1, 5))

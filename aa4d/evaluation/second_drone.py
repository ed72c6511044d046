"""Views that training never had: a second drone over the same traffic (docs/scenes.md, `second_flight`).

A frame of the first drone that is held out lies between two that were trained on, seen from almost the same place. The
second drone's are seen from elsewhere. What no training frame shows cannot be known: one score leaves it out.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.capture.truth import depth_of, moving_mask
from aa4d.errors import InputError
from aa4d.evaluation.image_metrics import StructuralSimilarity, capped, psnr
from aa4d.evaluation.lpips import Network
from aa4d.evaluation.lpips_weights import Perceptual
from aa4d.evaluation.surface import surface_points
from aa4d.evaluation.true_motion import true_viewmats
from aa4d.evaluation.views import as_float, render_pose, save_png
from aa4d.files import make_folder
from aa4d.methods.model_file import LoadedModel

FOLDER = "second"  # in a capture, and in a run's eval/
AGREES = 0.02  # share of the depth: two depths nearer than this are of one surface
SHOWN = 3  # pictures that are kept


@dataclass(frozen=True)
class ViewScores:
    """Means over frames of the second drone; None where no pixel counts."""

    frames: int
    psnr: float
    ssim: float
    lpips: dict[Network, float]
    psnr_dynamic: float | None  # moving pixels
    psnr_still: float | None  # the others
    psnr_seen: float | None  # moving pixels, and of the others those whose surface some training frame shows
    seen_share: float | None  # share of the pixels that `psnr_seen` counts
    psnr_training_times: float | None  # at instants that training saw from the first drone
    psnr_held_out_times: float | None  # at instants that it did not


def second_capture(capture: Capture) -> Capture | None:
    """The second drone's capture beside that of the first, or None where there is none.

    Raises:
        InputError: it is unfinished, damaged, or of other instants than the first's.
    """
    folder = capture.folder / FOLDER
    if not folder.is_dir():
        return None
    second = read_capture(folder, to_train=False)
    if [frame.time_s for frame in second.frames] != [frame.time_s for frame in capture.frames]:
        raise InputError(f"{folder}: its frames have other times than those of {capture.folder}; render both again")
    check_content(folder)
    return second


def scored_frames(second: Capture, most: int) -> list[int]:
    """At most `most` of them, evenly over time, first and last included."""
    count = len(second.frames)
    return [int(n) for n in np.linspace(0, count - 1, min(most, count)).round()]


def score_second_drone(
    loaded: LoadedModel,
    capture: Capture,
    second: Capture,
    frames: list[int],
    perceptual: Perceptual,
    out: Path,
    progress: Callable[[], None],
) -> ViewScores:
    """Score frames of the second drone; writes the first, middle and last picture into `out`.

    Args:
        frames: ranks in `second`.
        progress: called once for each of them.
    """
    make_folder(out)
    kept = {frames[n] for n in np.linspace(0, len(frames) - 1, SHOWN).round().astype(int)}
    columns: dict[str, list[float]] = {}
    lpips: dict[Network, list[float]] = {network: [] for network in perceptual.loaded}
    training = training_depths(capture)
    for index in frames:
        truth, picture = as_float(read_image(second, second.frames[index])), _picture(loaded, second, index)
        if index in kept:
            save_png(out / f"{second.frames[index].name}.png", picture)
        image = as_float(picture)
        moving, seen = moving_mask(second, index), seen_pixels(second, index, training)
        whole = capped(psnr(image, truth))
        found: dict[str, float | None] = {"psnr": whole, "ssim": float(StructuralSimilarity(truth)(image))}
        masks = {"psnr_dynamic": moving, "psnr_still": None if moving is None else ~moving, "psnr_seen": seen}
        for name, mask in masks.items():
            some = mask is not None and bool(mask.any())
            found[name] = capped(psnr(image, truth, torch.from_numpy(mask))) if some else None
        found["seen_share"] = None if seen is None else float(seen.mean())
        is_training = capture.frames[index].split == "train"
        found["psnr_training_times" if is_training else "psnr_held_out_times"] = whole
        for name, value in found.items():
            if value is not None:
                columns.setdefault(name, []).append(value)
        for network, measure in perceptual.loaded.items():
            lpips[network].append(measure(image, truth))
        progress()

    def mean(name: str) -> float | None:
        return statistics.fmean(columns[name]) if name in columns else None

    return ViewScores(
        frames=len(frames),
        psnr=statistics.fmean(columns["psnr"]),
        ssim=statistics.fmean(columns["ssim"]),
        lpips={network: statistics.fmean(values) for network, values in lpips.items()},
        psnr_dynamic=mean("psnr_dynamic"),
        psnr_still=mean("psnr_still"),
        psnr_seen=mean("psnr_seen"),
        seen_share=mean("seen_share"),
        psnr_training_times=mean("psnr_training_times"),
        psnr_held_out_times=mean("psnr_held_out_times"),
    )


def _picture(loaded: LoadedModel, second: Capture, index: int) -> NDArray[np.uint8]:
    frame = second.frames[index]
    return render_pose(loaded, frame.t, frame.viewmat, second.camera)


@dataclass(frozen=True)
class TrainingDepth:
    viewmat: NDArray[np.float64]  # [4, 4]
    K: NDArray[np.float64]
    depth: NDArray[np.float32]  # [H, W] metres
    still: NDArray[np.bool_]  # [H, W]


def training_depths(capture: Capture) -> list[TrainingDepth]:
    """True depth of every training frame; an empty list without truth."""
    found, viewmats = [], true_viewmats(capture)
    for index in capture.of_split("train"):
        depth, moving = depth_of(capture, index), moving_mask(capture, index)
        if depth is None or moving is None:
            return []
        found.append(TrainingDepth(viewmats[index], capture.camera.K, depth, ~moving))
    return found


def seen_pixels(second: Capture, index: int, training: list[TrainingDepth]) -> NDArray[np.bool_] | None:
    """Pixels [H, W] of what moves, and of surfaces at rest that some training frame shows. None without truth."""
    depth, moving = depth_of(second, index), moving_mask(second, index)
    if depth is None or moving is None or not training:
        return None
    v, u = np.nonzero(np.isfinite(depth) & ~moving)
    points = surface_points(second.camera.K, second.frames[index].viewmat, depth)[v, u].T
    shown = np.zeros(len(u), bool)
    for view in training:
        shown[~shown] = _shows(view, points[:, ~shown])
    # The sky is at infinity: where one frame shows it in a direction, all do that look there; few scenes have any.
    seen = moving | ~np.isfinite(depth)
    seen[v[shown], u[shown]] = True
    return seen


def _shows(view: TrainingDepth, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which world points [3, P] a training frame shows: inside it, and at the depth that it has there."""
    height, width = view.depth.shape
    x, y, z = view.viewmat[:3, :3] @ points + view.viewmat[:3, 3:]
    front = z > 1e-6
    z = np.where(front, z, 1.0)
    u, v = view.K[0, 0] * x / z + view.K[0, 2], view.K[1, 1] * y / z + view.K[1, 2]
    inside = front & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    column, row = np.where(inside, u, 0).astype(int), np.where(inside, v, 0).astype(int)
    depth = view.depth[row, column]
    with np.errstate(invalid="ignore"):
        return inside & view.still[row, column] & (np.abs(depth - z) < AGREES * z)

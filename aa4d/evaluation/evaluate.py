"""`aa4d eval`: image quality on held-out frames, speed of the whole pipeline, sizes."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aa4d import __version__
from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.device import DeviceName, choose_device
from aa4d.errors import InputError
from aa4d.evaluation.activity import PooledError, activity_labels
from aa4d.evaluation.activity_share import rank_correlation
from aa4d.evaluation.image_metrics import StructuralSimilarity, capped, psnr
from aa4d.evaluation.lpips import Network
from aa4d.evaluation.lpips_weights import Perceptual, obtain
from aa4d.evaluation.motion import MotionScores, measure_motion, motion_steps
from aa4d.evaluation.plots import plot_psnr
from aa4d.evaluation.second_drone import FOLDER as SECOND_DRONE
from aa4d.evaluation.second_drone import ViewScores, score_second_drone, scored_frames, second_capture
from aa4d.evaluation.speed import TIMED_FRAMES, WARM_UP_FRAMES, measure_speed, neural_mib
from aa4d.evaluation.swept_ground import SweptGround
from aa4d.evaluation.views import as_float, render_frame, save_png
from aa4d.files import make_folder, write_json
from aa4d.identity import Identity, digest_of
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.motion.score import score_tracks
from aa4d.motion.tracks_file import load_tracks, tracks_path

TRAINING_FRAMES = 32  # at most so many of them are scored, evenly over time, for the gap to the held-out ones
SECOND_DRONE_FRAMES = 32  # likewise of a second drone's
MOTION_PICTURE = "motion.png"
GROUND = ("elsewhere", SWEPT := "swept")


class Steps:
    """A count for whoever waits."""

    def __init__(self, progress: Callable[[int, int], None], total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def next(self) -> None:
        self._done += 1
        self._progress(self._done, self._total)


@dataclass(frozen=True)
class FrameScore:
    frame: str
    t: float
    psnr: float
    ssim: float
    lpips: dict[Network, float]  # by network
    psnr_dynamic: float | None  # over moving pixels; None without truth or where nothing moves
    psnr_dynamic_static: float | None  # the coarse stage's, on the same pixels
    psnr_still: float | None  # over the other pixels
    moving_share: float | None


@dataclass(frozen=True)
class TrainingFrameScore:
    frame: str
    t: float
    psnr: float


@dataclass(frozen=True)
class Metrics:
    """Means over held-out frames (infinite values, of identical images, count as 100 dB)."""

    method: str
    psnr: float
    ssim: float
    lpips: dict[Network, float]  # by network
    lpips_not_measured: dict[Network, str]  # why, by network
    psnr_dynamic: float | None
    psnr_still: float | None
    psnr_static: float | None  # the model frozen at its coarse stage, whole image
    psnr_dynamic_static: float | None  # likewise, moving pixels
    psnr_activity: dict[str, float]  # by activity class, errors pooled over the frames; empty without truth
    psnr_activity_static: dict[str, float]  # likewise, the coarse stage
    psnr_swept: float | None  # ground that movers drive over at another time: where ghosts show; None without truth
    psnr_swept_static: float | None  # likewise, the coarse stage
    activity_share: dict[str, float]  # of the pixels with activity truth
    heterogeneity: dict[str, float]  # of the scene, as its capture says (docs/truth.md)
    activity_rank_correlation: float | None  # of weights on spatio-temporal planes with true activity, over anchors
    track_recall: float | None  # share of vehicle-frames on the tracks that the run found; None without tracks or truth
    tracks_false: int | None  # of the run's tracks, those that follow nothing that moves
    vehicles_missed: int | None
    motion: MotionScores  # its keys stand beside these in the file
    second_drone: ViewScores | None  # None where the capture has no second drone
    psnr_training: float  # over training frames: how much of the quality is memory
    fps: float
    fps_cached: float | None  # from the method's evaluation cache; None where it has none
    cache: str | None  # what that cache is
    warm_up_frames: int
    timed_frames: int
    resolution: tuple[int, int]
    device: str  # "cpu" or "cuda", of fps
    threads: int
    training_seconds: float
    training_processor_seconds: float | None  # of all threads; None of a run of an older version
    anchors: int  # or free Gaussians: units that grow and go
    gaussians: int  # mean number with a positive opacity over the timed frames
    neural_mib: float  # networks and planes
    total_mib: float  # the model file
    frames: tuple[FrameScore, ...]
    training_frames: tuple[TrainingFrameScore, ...]
    identity: Identity

    def as_json(self) -> dict[str, Any]:
        values = asdict(self)
        return values | values.pop("motion") | {"identity": self.identity.as_json()}


def evaluate(
    run: Path,
    capture_folder: Path | None,
    progress: Callable[[int, int], None],
    perceptual: Perceptual | None = None,
    *,
    device: DeviceName = "auto",
    into: Path | None = None,
) -> Metrics:
    """Score `run`/model.safetensors; writes `metrics.json`, and the held-out renders and a plot into `run`/eval.

    The model file is read and never written: what the held-out frames hold reaches the scores alone.

    Args:
        capture_folder: where the capture lies; None to follow the path in the model file.
        perceptual: LPIPS; None for AlexNet's, where its weights are at hand.
        device: where the model is rendered; images are compared on the CPU.
        into: the folder to write into, instead of `run`.

    Raises:
        InputError: no model, no capture, a capture without held-out frames, tracks of another run, a second drone's
            capture that is unfinished or of other times, or no such device.
    """
    chosen = choose_device(device)
    loaded = load_model(run / "model.safetensors", chosen)
    static = load_model(run / "coarse.safetensors", chosen) if (run / "coarse.safetensors").exists() else None
    capture = capture_of(loaded, capture_folder)
    held_out = capture.of_split("test")
    if not held_out:
        raise InputError(f'{capture.folder}: has no held-out frame (split "test"), so there is nothing to evaluate on')
    track_scores = _track_scores(run, loaded, capture)
    perceptual = perceptual or obtain(None)
    perceptual = perceptual.for_size(capture.camera.width, capture.camera.height)
    training = _spread(capture.of_split("train"), TRAINING_FRAMES)
    into = into or run
    out = into / "eval"
    make_folder(out)
    second = second_capture(capture)
    views = [] if second is None else scored_frames(second, SECOND_DRONE_FRAMES)
    steps = Steps(progress, len(held_out) + len(training) + motion_steps(loaded, capture) + len(views))

    scores, static_psnrs = [], []
    by_class, by_class_static = PooledError(), PooledError()
    swept, swept_static = PooledError(GROUND), PooledError(GROUND)
    ground = SweptGround(capture)
    for index in held_out:
        frame = capture.frames[index]
        truth = as_float(read_image(capture, frame))
        picture = render_frame(loaded, capture, index)
        save_png(out / f"{frame.name}.png", picture)
        image, frozen = as_float(picture), None
        if static is not None:
            picture = render_frame(static, capture, index)
            save_png(out / f"{frame.name}_static.png", picture)
            frozen = as_float(picture)
            static_psnrs.append(capped(psnr(frozen, truth)))
        regions = (
            (activity_labels(capture, index), by_class, by_class_static),
            (ground.of_frame(index), swept, swept_static),
        )
        for region, errors, errors_static in regions:
            if region is not None:
                errors.add(image, truth, region.astype(np.uint8))
                if frozen is not None:
                    errors_static.add(frozen, truth, region.astype(np.uint8))
        scores.append(_score(capture, index, truth, image, frozen, perceptual))
        steps.next()
    training_scores = []
    for index in training:
        training_scores.append(_score_training(loaded, capture, index))
        steps.next()
    motion = measure_motion(loaded, static, capture, steps.next)
    if motion.picture is None:
        (out / MOTION_PICTURE).unlink(missing_ok=True)
    else:
        save_png(out / MOTION_PICTURE, motion.picture)

    from_elsewhere = None
    if second is not None:
        place = out / SECOND_DRONE
        from_elsewhere = score_second_drone(loaded, capture, second, views, perceptual, place, steps.next)
    speed = measure_speed(loaded, capture)
    metrics = Metrics(
        method=loaded.method,
        psnr=statistics.fmean(s.psnr for s in scores),
        ssim=statistics.fmean(s.ssim for s in scores),
        lpips={network: statistics.fmean(s.lpips[network] for s in scores) for network in perceptual.loaded},
        lpips_not_measured=perceptual.missing,
        psnr_dynamic=_mean(s.psnr_dynamic for s in scores),
        psnr_still=_mean(s.psnr_still for s in scores),
        psnr_static=_mean(static_psnrs),
        psnr_dynamic_static=_mean(s.psnr_dynamic_static for s in scores),
        psnr_activity=_capped_all(by_class.psnr()),
        psnr_activity_static=_capped_all(by_class_static.psnr()),
        psnr_swept=_capped_all(swept.psnr()).get(SWEPT),
        psnr_swept_static=_capped_all(swept_static.psnr()).get(SWEPT),
        activity_share=by_class.share(),
        heterogeneity=capture.heterogeneity,
        activity_rank_correlation=rank_correlation(loaded, capture),
        **track_scores,
        motion=motion.scores,
        second_drone=from_elsewhere,
        psnr_training=statistics.fmean(s.psnr for s in training_scores),
        fps=speed.fps,
        fps_cached=speed.fps_cached,
        cache=speed.cache,
        warm_up_frames=WARM_UP_FRAMES,
        timed_frames=TIMED_FRAMES,
        resolution=(capture.camera.width, capture.camera.height),
        device=chosen.type,
        threads=torch.get_num_threads(),
        training_seconds=loaded.training_seconds,
        training_processor_seconds=loaded.training_processor_seconds,
        anchors=len(loaded.model),
        gaussians=speed.gaussians,
        neural_mib=neural_mib(loaded.model),
        total_mib=loaded.path.stat().st_size / 2**20,
        frames=tuple(scores),
        training_frames=tuple(training_scores),
        identity=evaluation_identity(loaded, capture, second, list(perceptual.loaded), chosen.type),
    )
    plot_psnr(out / "psnr.png", metrics.as_json())
    write_json(into / "metrics.json", metrics.as_json())
    return metrics


def evaluation_identity(
    loaded: LoadedModel, capture: Capture, second: Capture | None, networks: list[Network], device: str
) -> Identity:
    """Of what is measured and by which version: the scores of a model on a capture."""
    settings = {"version": __version__, "lpips": sorted(networks), "device": device}
    made_from = {"model": loaded.identity.digest(), "capture": capture.identity.digest()}
    if second is not None:
        made_from["second_drone"] = second.identity.digest()
    return Identity("evaluation", digest_of(settings), made_from)


def _track_scores(run: Path, loaded: LoadedModel, capture: Capture) -> dict[str, Any]:
    """Raises InputError where the run's tracks are damaged, or are those of another run."""
    path, groups = tracks_path(run), loaded.model.groups
    if capture.tracks is None or not path.exists():
        return {"track_recall": None, "tracks_false": None, "vehicles_missed": None}
    try:
        tracks = load_tracks(path)
    except InputError:
        raise InputError(f"{path}: cannot be read as tracks; delete it to be scored without them") from None
    shown = np.zeros((0, 4)) if groups is None else groups.shown.numpy(force=True)
    if len(tracks) != len(shown) or not np.array_equal(tracks.shown.astype(np.float32), shown.astype(np.float32)):
        raise InputError(
            f"{path}: is of another run than the model beside it; put the run's own back, or delete it to be scored "
            "without tracks"
        )
    score = score_tracks(tracks, capture)
    return {
        "track_recall": score.recall,
        "tracks_false": len(score.false),
        "vehicles_missed": len(score.missed),
    }


def capture_of(loaded: LoadedModel, named: Path | None) -> Capture:
    """The capture that a model was trained on, at the folder `named` or where the model file says.

    Raises:
        InputError: it is not there, is another one, or is not as it was made.
    """
    folder = named or loaded.capture_folder
    if folder is None:
        raise InputError(f"{loaded.path}: names no capture; say where it lies with --capture")
    if named is None and not folder.is_dir():
        raise InputError(f"{folder}: the capture is not there any more; say where it lies with --capture")
    capture = read_capture(folder)
    if not is_trained_on(loaded, capture):
        raise InputError(
            f"{folder}: is not the capture that {loaded.path} was trained on; name that one with --capture, or train "
            "again"
        )
    check_content(folder)
    return capture


def is_trained_on(loaded: LoadedModel, capture: Capture) -> bool:
    """Compare identities; a model file of an older version knows the fingerprint of the index, or nothing."""
    known = loaded.identity.made_from.get("capture")
    if known is None:
        return loaded.capture_fingerprint in (None, capture.fingerprint)
    return known == capture.identity.digest()


def _score(
    capture: Capture, index: int, truth: Tensor, image: Tensor, frozen: Tensor | None, perceptual: Perceptual
) -> FrameScore:
    mask = moving_mask(capture, index)
    dynamic = dynamic_static = still = None
    if mask is not None:
        pixels = torch.from_numpy(mask)
        if mask.any():
            dynamic = capped(psnr(image, truth, pixels))
            dynamic_static = None if frozen is None else capped(psnr(frozen, truth, pixels))
        if not mask.all():
            still = capped(psnr(image, truth, ~pixels))
    return FrameScore(
        frame=capture.frames[index].name,
        t=capture.frames[index].t,
        psnr=capped(psnr(image, truth)),
        ssim=float(StructuralSimilarity(truth)(image)),
        lpips={network: measure(image, truth) for network, measure in perceptual.loaded.items()},
        psnr_dynamic=dynamic,
        psnr_dynamic_static=dynamic_static,
        psnr_still=still,
        moving_share=None if mask is None else float(mask.mean()),
    )


def _score_training(loaded: LoadedModel, capture: Capture, index: int) -> TrainingFrameScore:
    frame = capture.frames[index]
    truth = as_float(read_image(capture, frame))
    image = as_float(render_frame(loaded, capture, index))
    return TrainingFrameScore(frame.name, frame.t, capped(psnr(image, truth)))


def _spread(indices: list[int], count: int) -> list[int]:
    """At most `count` of them, evenly, first and last included."""
    positions = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
    return [indices[i] for i in positions]


def _capped_all(decibels: dict[str, float]) -> dict[str, float]:
    return {name: capped(value) for name, value in decibels.items()}


def _mean(values: Any) -> float | None:
    present = [v for v in values if v is not None]
    return statistics.fmean(present) if present else None

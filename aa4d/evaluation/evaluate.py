"""`aa4d eval`: image quality on held-out frames, speed of the whole pipeline, sizes."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from aa4d.capture.reader import Capture, moving_mask, read_capture, read_image
from aa4d.errors import InputError
from aa4d.evaluation.image_metrics import StructuralSimilarity, psnr
from aa4d.files import make_folder, whole_file, write_json
from aa4d.model import AdaAnchor4D
from aa4d.model_file import LoadedModel, load_model
from aa4d.raster.types import Camera
from aa4d.rendering import render

WARM_UP_FRAMES = 5
TIMED_FRAMES = 50


@dataclass(frozen=True)
class FrameScore:
    frame: str
    t: float
    psnr: float
    ssim: float
    psnr_dynamic: float | None  # over moving pixels; None without truth or where nothing moves
    psnr_dynamic_static: float | None  # the coarse stage's, on the same pixels
    moving_share: float | None


@dataclass(frozen=True)
class Metrics:
    """Means over held-out frames (infinite values, of identical images, count as 100 dB)."""

    psnr: float
    ssim: float
    psnr_dynamic: float | None
    psnr_static: float | None  # the model frozen at its coarse stage, whole image
    psnr_dynamic_static: float | None  # likewise, moving pixels
    fps: float
    resolution: tuple[int, int]
    threads: int
    training_seconds: float
    anchors: int
    gaussians: int  # mean number with a positive opacity over the timed frames
    neural_mib: float  # networks and planes
    total_mib: float  # the model file
    frames: tuple[FrameScore, ...]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def evaluate(run: Path, capture_folder: Path | None, progress: Callable[[int, int], None]) -> Metrics:
    """Score `run`/model.safetensors and write `metrics.json` and the held-out renders into `run`/eval.

    Args:
        capture_folder: where the capture lies; None to follow the path in the model file.

    Raises:
        InputError: no model, no capture, or a capture without held-out frames.
    """
    if run.is_file():
        raise InputError(f"{run}: is a file; name the folder of the run that holds it")
    loaded = load_model(run / "model.safetensors")
    static = load_model(run / "coarse.safetensors") if (run / "coarse.safetensors").exists() else None
    folder = capture_folder or loaded.capture_folder
    if folder is None:
        raise InputError(f"{loaded.path}: names no capture; say where it lies with --capture")
    if capture_folder is None and not folder.is_dir():
        raise InputError(f"{folder}: the capture is not there any more; say where it lies with --capture")
    capture = read_capture(folder)
    if loaded.capture_fingerprint not in (None, capture.fingerprint):
        raise InputError(f"{folder}: is not the capture that {loaded.path} was trained on")
    held_out = capture.of_split("test")
    if not held_out:
        raise InputError(f'{folder}: has no held-out frame (split "test"), so there is nothing to evaluate on')
    out = run / "eval"
    make_folder(out)
    scores, static_psnrs = [], []
    for done, index in enumerate(held_out):
        frame = capture.frames[index]
        truth = torch.from_numpy(read_image(capture, frame)).float() / 255
        image = render_frame(loaded, capture, index)
        save_png(out / f"{frame.name}.png", image)
        frozen = None
        if static is not None:
            frozen = render_frame(static, capture, index)
            save_png(out / f"{frame.name}_static.png", frozen)
            static_psnrs.append(_finite(psnr(_as_float(frozen), truth)))
        scores.append(_score(capture, index, truth, image, frozen))
        progress(done + 1, len(held_out))
    fps, gaussians = measure_speed(loaded, capture)
    metrics = Metrics(
        psnr=statistics.fmean(s.psnr for s in scores),
        ssim=statistics.fmean(s.ssim for s in scores),
        psnr_dynamic=_mean(s.psnr_dynamic for s in scores),
        psnr_static=_mean(static_psnrs),
        psnr_dynamic_static=_mean(s.psnr_dynamic_static for s in scores),
        fps=fps,
        resolution=(capture.camera.width, capture.camera.height),
        threads=torch.get_num_threads(),
        training_seconds=loaded.training_seconds,
        anchors=len(loaded.model.anchors),
        gaussians=gaussians,
        neural_mib=neural_mib(loaded.model),
        total_mib=loaded.path.stat().st_size / 2**20,
        frames=tuple(scores),
    )
    write_json(run / "metrics.json", metrics.as_json())
    return metrics


def render_frame(loaded: LoadedModel, capture: Capture, index: int) -> NDArray[np.uint8]:
    """The model at the time and pose of a frame: [H, W, 3] 8-bit sRGB, as it would be saved."""
    with torch.no_grad():
        color = render(loaded.model, *_view(loaded, capture, index)).rendering.color
    return (color.clamp(0, 1) * 255).round().byte().numpy()


def measure_speed(loaded: LoadedModel, capture: Capture) -> tuple[float, int]:
    """Frames per second of deform + decode + rasterise (median, after a warm-up), and Gaussians drawn a frame."""
    seconds, drawn = [], []
    with torch.no_grad():
        for number in range(WARM_UP_FRAMES + TIMED_FRAMES):
            view = _view(loaded, capture, number % len(capture.frames))
            started = time.perf_counter()
            gaussians = render(loaded.model, *view).gaussians
            elapsed = time.perf_counter() - started
            if number >= WARM_UP_FRAMES:
                seconds.append(elapsed)
                drawn.append(int((gaussians.opacities > 0).sum()))
    return 1 / statistics.median(seconds), round(statistics.fmean(drawn))


def neural_mib(model: AdaAnchor4D) -> float:
    """Networks and planes, without what anchors own, in MiB: the paper's "neural size"."""
    return sum(value.numel() * value.element_size() for value in model.networks_and_planes()) / 2**20


def save_png(path: Path, image: NDArray[np.uint8]) -> None:
    with whole_file(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def _view(loaded: LoadedModel, capture: Capture, index: int) -> tuple[float | None, Camera, Tensor]:
    c, frame = capture.camera, capture.frames[index]
    # Where poses were refined, the model's differ from the capture's.
    viewmat = loaded.viewmats.get(frame.name, frame.viewmat)
    camera = loaded.frame.camera(viewmat, c.K, c.width, c.height)
    return None if loaded.is_static else frame.t, camera, torch.tensor(loaded.background)


def _score(
    capture: Capture, index: int, truth: Tensor, image: NDArray[np.uint8], frozen: NDArray[np.uint8] | None
) -> FrameScore:
    rendered = _as_float(image)
    mask = moving_mask(capture, index)
    dynamic = dynamic_static = None
    if mask is not None and mask.any():
        pixels = torch.from_numpy(mask)
        dynamic = _finite(psnr(rendered, truth, pixels))
        dynamic_static = None if frozen is None else _finite(psnr(_as_float(frozen), truth, pixels))
    return FrameScore(
        frame=capture.frames[index].name,
        t=capture.frames[index].t,
        psnr=_finite(psnr(rendered, truth)),
        ssim=float(StructuralSimilarity(truth)(rendered)),
        psnr_dynamic=dynamic,
        psnr_dynamic_static=dynamic_static,
        moving_share=None if mask is None else float(mask.mean()),
    )


def _as_float(image: NDArray[np.uint8]) -> Tensor:
    return torch.from_numpy(image).float() / 255


def _finite(decibels: float) -> float:
    return min(decibels, 100.0) if not math.isnan(decibels) else decibels


def _mean(values: Any) -> float | None:
    present = [v for v in values if v is not None]
    return statistics.fmean(present) if present else None

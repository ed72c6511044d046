"""Coarse stage, DACW, fine stage (paper, sections 4.4 and 5.1)."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import EMBEDDINGS, Anchors, spacing, voxel_centres
from aa4d.anchors.densification import Growth, Statistics, grow, transparent
from aa4d.capture.frame import ModelFrame, frame_of
from aa4d.capture.reader import Capture, read_images
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.image_metrics import decibels
from aa4d.field.planes import regularisation
from aa4d.field.warping import density_adaptive_boundaries
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.kernels.image_loss import image_loss
from aa4d.model import AdaAnchor4D, ModelConfig
from aa4d.model_file import save_model
from aa4d.raster.types import Camera
from aa4d.rendering import Rendered, render
from aa4d.training.checkpoints import TrainingState, load_checkpoint, save_checkpoint
from aa4d.training.config import TrainingConfig, temporal_resolution
from aa4d.training.interrupts import StopRequest, stop_requests
from aa4d.training.optimiser import make_optimiser, replace_rows, set_rates

STAGES = ("coarse", "fine")


# What the trainer tells whoever watches, once an iteration: stage, iteration, total, loss, PSNR in dB, anchors.
Progress = Callable[[str, int, int, float, float, int], None]


@dataclass(frozen=True)
class View:
    """One training frame, ready to be learned from."""

    t: float
    camera: Camera
    pixels: Tensor  # [H, W, 3] uint8

    def target(self) -> Tensor:
        return self.pixels.float() / 255


def train(capture: Capture, out: Path, config: TrainingConfig, progress: Progress) -> Path:
    """Train, or continue a run that was stopped; a finished run is left as it is.

    Writes `config.json`, `checkpoint.safetensors`, `coarse.safetensors` and `model.safetensors` into `out`.

    Returns:
        The path of the model file.

    Raises:
        InputError: `out` holds something else, or the capture cannot be read.
        Interrupted: Ctrl-C; the checkpoint and a usable model file of that moment are written.
    """
    model_config = ModelConfig(temporal_resolution=temporal_resolution(len(capture.frames)))
    settings = {
        "capture": str(capture.folder.resolve()),
        "capture_fingerprint": capture.fingerprint,
        "training": dataclasses.asdict(config),
        "model": dataclasses.asdict(model_config),
    }
    _check_folder(out, settings)
    # Every image is read here, so that bad input is refused before anything is written.
    run = Run(capture, out, config, model_config)
    make_folder(out)
    write_json(out / "config.json", settings)
    checkpoint = out / "checkpoint.safetensors"
    if checkpoint.exists():
        state = load_checkpoint(checkpoint, model_config, config.rates)
        if state.stage == "fine" and state.iteration == config.fine_iterations and run.model_path.exists():
            return run.model_path
    else:
        state = run.initial_state()
    run.train(state, progress)
    return run.model_path


def _check_folder(out: Path, settings: dict[str, Any]) -> None:
    """Raises InputError where `out` holds something other than this very run."""
    path = out / "config.json"
    if not path.exists():
        if out.is_dir() and any(out.iterdir()):
            raise InputError(f"{out}: not empty and not a training run; choose a new folder with --out")
        return
    found = read_json_object(path, "the settings of a training run")
    # Through JSON, so that tuples and lists compare alike.
    wanted = json.loads(json.dumps(settings))
    for key in ("capture_fingerprint", "training", "model"):
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{out}: holds a run with another {key.replace('_', ' ')} (see {path}); "
                "choose a new folder with --out, or delete that one"
            )


class Run:
    """One training run: what stays fixed over it, and the loop."""

    def __init__(self, capture: Capture, out: Path, config: TrainingConfig, model_config: ModelConfig) -> None:
        self.capture = capture
        self.out = out
        self.config = config
        self.model_config = model_config
        self.model_path = out / "model.safetensors"
        self.frame: ModelFrame = frame_of(capture)
        indices = capture.of_split("train")
        images = torch.from_numpy(read_images(capture, indices))
        c = capture.camera
        self.views = [
            View(capture.frames[i].t, self.frame.camera(capture.frames[i].viewmat, c.K, c.width, c.height), image)
            for i, image in zip(indices, images, strict=True)
        ]
        # What no anchor covers shows the mean colour of the training frames: the least wrong constant.
        self.background = images.float().mean(dim=(0, 1, 2)) / 255
        self.voxel = config.voxel_px / float(c.K[0, 0])

    def initial_state(self) -> TrainingState:
        torch.manual_seed(self.config.seed)
        centres = voxel_centres(self.frame.to_model(self.capture.points), self.voxel)
        scale = spacing(centres, floor=1e-3 * self.voxel)
        anchors = Anchors(
            torch.from_numpy(centres).float(),
            torch.from_numpy(np.log(scale)).float()[:, None].repeat(1, 6),
            self.model_config.offsets,
            self.model_config.feature_dim,
            self.model_config.embedding_dim,
        )
        model = AdaAnchor4D(self.model_config, anchors)
        optimiser = make_optimiser(model, self.config.rates, "coarse")
        return TrainingState(
            "coarse", 0, 0.0, model, optimiser, Statistics.zeros(len(anchors), anchors.offset.shape[1])
        )

    def train(self, state: TrainingState, progress: Progress) -> None:
        with stop_requests() as stop_requested:
            while True:
                self._stage(state, progress, stop_requested)
                if state.stage == "fine":
                    break
                self._enter_fine(state)
        self._save(state)

    def _stage(self, state: TrainingState, progress: Progress, stop_requested: StopRequest) -> None:
        total = self.config.iterations(state.stage)
        while state.iteration < total:
            started = time.perf_counter()
            loss, psnr_db = self.step(state)
            state.iteration += 1
            state.seconds += time.perf_counter() - started
            progress(state.stage, state.iteration, total, loss, psnr_db, len(state.model.anchors))
            if stop_requested():
                self._save(state)
                raise Interrupted(
                    f"stopped at {state.stage} iteration {state.iteration} of {total}; {self.out} is usable as it is, "
                    "and the same command continues from there"
                )
            if state.iteration % self.config.checkpoint_every == 0:
                self._save_checkpoint(state)

    def step(self, state: TrainingState) -> tuple[float, float]:
        """One iteration on one view; returns loss and PSNR of that view.

        Raises:
            InputError: what is drawn or the loss is not finite; names the first parameter group that is not.
        """
        view = self._view(state.stage, state.iteration)
        model, optimiser = state.model, state.optimiser
        set_rates(optimiser, state.iteration / max(self.config.iterations(state.stage) - 1, 1))
        t = view.t if state.stage == "fine" else None
        try:
            rendered = render(model, t, view.camera, self.background)
        except ValueError as error:  # the rasteriser draws no NaN; it names the tensor
            self._refuse_not_finite(state, f"what it draws ({error})")
        target = view.target()
        loss, squared_error = self._loss(model, state.stage, rendered, target)
        if not math.isfinite(loss.item()):
            self._refuse_not_finite(state, "its loss")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        with torch.no_grad():
            self._densify(state, rendered)
        return loss.item(), decibels(squared_error.item())

    def _view(self, stage: str, iteration: int) -> View:
        """Every view once an epoch, in an order drawn from (seed, stage, epoch)."""
        epoch, position = divmod(iteration, len(self.views))
        order = np.random.default_rng([self.config.seed, STAGES.index(stage), epoch]).permutation(len(self.views))
        return self.views[order[position]]

    def _loss(self, model: AdaAnchor4D, stage: str, rendered: Rendered, target: Tensor) -> tuple[Tensor, Tensor]:
        """The loss, and the squared error of the image."""
        weights, rendering = self.config.loss, rendered.rendering
        loss, squared_error = image_loss(rendering.color, target, weights.dssim)
        drawn = (rendering.radii > 0).float()
        x, y, z = rendered.gaussians.scales.unbind(1)  # the gradient of prod() takes ten times as long
        volume = (x * y * z * drawn).sum() / drawn.sum().clamp_min(1)
        loss = loss + weights.volume * volume
        if stage == "fine":
            loss = loss + regularisation(
                model.field, weights.plane_smoothness, weights.time_smoothness, weights.time_constancy
            )
        return loss, squared_error

    def _densify(self, state: TrainingState, rendered: Rendered) -> None:
        d = self.config.densification
        done = state.iteration + 1
        if not d.statistics_from < done <= d.until:
            return
        anchors = state.model.anchors
        state.statistics.add(rendered.visible, rendered.gaussians, rendered.rendering)
        if done <= d.start or done % d.interval:
            return
        seen = d.interval * d.seen_share
        keep = ~transparent(state.statistics, min_opacity=d.min_opacity, min_seen=seen)
        generator = torch.Generator().manual_seed(
            int(np.random.SeedSequence([self.config.seed, STAGES.index(state.stage), done]).generate_state(1)[0])
        )
        growth = grow(
            anchors.position,
            anchors.position[:, None] + anchors.offset * anchors.log_scale[:, None, :3].exp(),
            state.statistics,
            voxel=self.voxel,
            voxel_factor=d.voxel_factor,
            levels=d.levels,
            gradient_threshold=d.gradient_threshold,
            min_drawn=0.5 * seen,
            limit=max(d.max_anchors - len(anchors), 0),
            generator=generator,
        )
        state.statistics.forget_judged(min_seen=seen, min_drawn=0.5 * seen)
        change_anchors(state, keep, growth)

    def _enter_fine(self, state: TrainingState) -> None:
        """Build DACW and the field's box from the anchors of the coarse stage, and start a new optimiser."""
        model, w = state.model, self.config.warp
        position = model.anchors.position
        model.field.box.copy_(torch.stack([position.amin(0), position.amax(0)]))
        u = model.field.normalise(position)
        model.warp.boundaries.copy_(
            density_adaptive_boundaries(u, self.model_config.bins, w.smoothing, w.gamma, w.lambda_min, w.lambda_max)
        )
        self._save_model(state, self.out / "coarse.safetensors")
        state.stage, state.iteration = "fine", 0
        state.optimiser = make_optimiser(model, self.config.rates, "fine")
        state.statistics = Statistics.zeros(len(position), self.model_config.offsets)
        self._save_checkpoint(state)

    def _save(self, state: TrainingState) -> None:
        self._save_checkpoint(state)
        self._save_model(state, self.model_path)

    def _save_checkpoint(self, state: TrainingState) -> None:
        """Only ever over the last one with finite values: it is what a diverged run goes back to."""
        if not all(torch.isfinite(p).all() for p in state.model.parameters()):
            self._refuse_not_finite(state, "a parameter")
        save_checkpoint(self.out / "checkpoint.safetensors", state)

    def _save_model(self, state: TrainingState, path: Path) -> None:
        training: dict[str, Any] = {
            "preset": self.config.preset,
            "seed": self.config.seed,
            "iterations": state.iteration,
            "seconds": round(state.seconds, 3),
            "capture_fingerprint": self.capture.fingerprint,
        }
        background = tuple(float(c) for c in self.background)
        save_model(
            path,
            state.model,
            stage=state.stage,
            capture=self.capture,
            frame=self.frame,
            background=(background[0], background[1], background[2]),
            training=training,
        )

    def _refuse_not_finite(self, state: TrainingState, what: str) -> NoReturn:
        names = [
            group["name"]
            for group in state.optimiser.param_groups
            if any(not torch.isfinite(p).all() for p in group["params"])
        ]
        advice = f"lower the learning rate of {names[0]!r}" if names else "check the poses and images of the capture"
        raise InputError(
            f"{self.out}: training met NaN or infinity in {what} at {state.stage} iteration {state.iteration}; "
            f"{advice} and start from the last checkpoint, which is whole"
        )


def change_anchors(state: TrainingState, keep: Tensor, growth: Growth) -> None:
    """Drop the anchors outside `keep` and add the grown ones; moments and statistics follow.

    A grown anchor has its parent's feature and embeddings, no offsets, and the voxel's edge as its scales.
    """
    anchors = state.model.anchors
    kept = keep.nonzero()[:, 0]
    rows = torch.cat([kept, torch.full_like(growth.parent, -1)])
    inherited = torch.cat([kept, growth.parent])
    offset, log_scale = anchors.offset.detach(), anchors.log_scale.detach()
    values = {name: getattr(anchors, name).detach()[inherited] for name in ("feature", *EMBEDDINGS)}
    values["offset"] = torch.cat([offset[kept], torch.zeros_like(offset[growth.parent])])
    values["log_scale"] = torch.cat([log_scale[kept], growth.voxel.log()[:, None].repeat(1, 6)])
    for name, value in values.items():
        parameter = nn.Parameter(value)
        replace_rows(state.optimiser, getattr(anchors, name), parameter, rows)
        setattr(anchors, name, parameter)
    anchors.position = torch.cat([anchors.position[kept], growth.position])
    state.statistics = state.statistics.rows(rows)

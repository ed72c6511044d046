"""Coarse stage, DACW, fine stage (paper, sections 4.4 and 5.1)."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aa4d.anchors.canonical import Anchors, spacing, voxel_centres
from aa4d.anchors.densification import Statistics
from aa4d.capture.frame import ModelFrame, frame_of
from aa4d.capture.reader import Capture, read_images
from aa4d.device import DeviceName, choose_device
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.image_metrics import decibels
from aa4d.field.planes import regularisation
from aa4d.field.warping import density_adaptive_boundaries
from aa4d.interrupts import StopRequest, stop_requests
from aa4d.kernels.image_loss import image_loss
from aa4d.model import AdaAnchor4D, ModelConfig
from aa4d.model_file import save_model
from aa4d.motion.tracks import Tracks
from aa4d.motion.tracks_file import load_tracks, movers_path, save_tracks, tracks_path
from aa4d.motion.truth import truth_tracks
from aa4d.raster.types import Camera
from aa4d.rendering import Rendered, render
from aa4d.training.checkpoints import TrainingState, load_checkpoint, save_checkpoint
from aa4d.training.config import TrainingConfig, temporal_resolution
from aa4d.training.growth import densify
from aa4d.training.history import History
from aa4d.training.optimiser import make_optimiser, set_rates
from aa4d.training.poses import PoseRefinement, refined
from aa4d.training.riding import FloatArray, add_riders, check_source, find, membership_loss
from aa4d.training.run_folder import check_folder, claimed
from aa4d.training.watchdog import NotFinite, Watch, advice, check_finite

RESTART = "delete the run and train again"
# By stage, of what is drawn at random in it.
STAGE_SEEDS = {"coarse": 0, "fine": 1, "clean": 2}


# What the trainer tells whoever watches, once an iteration: stage, iteration, total, loss, PSNR in dB, anchors.
Progress = Callable[[str, int, int, float, float, int], None]
# And now and then, in a sentence.
Say = Callable[[str], None]


@dataclass(frozen=True)
class View:
    """One training frame, ready to be learned from."""

    t: float
    camera: Camera
    pixels: Tensor  # [H, W, 3] uint8

    def target(self) -> Tensor:
        return self.pixels.float() / 255


def train(
    capture: Capture,
    out: Path,
    config: TrainingConfig,
    progress: Progress,
    *,
    variant: dict[str, Any] | None = None,
    device: DeviceName = "auto",
    tensorboard: bool = False,
    say: Say = lambda _: None,
) -> Path:
    """Train, or continue a run that was stopped or killed; a finished run is left as it is.

    Writes `config.json`, `history.csv`, `checkpoint.safetensors`, `coarse.safetensors` and `model.safetensors` into
    `out`.

    Args:
        variant: settings of `ModelConfig` that differ from its defaults.

    Returns:
        The path of the model file.

    Raises:
        InputError: `out` holds something else, the capture cannot be read, the device is not there, or the training
            met NaN or infinity: the last checkpoint is then the last good one.
        Interrupted: Ctrl-C; the checkpoint and a usable model file of that moment are written.
    """
    chosen = choose_device(device)
    model_config = model_config_of(capture, variant or {})
    settings = settings_of(capture, config, model_config)
    check_folder(out, settings)
    if config.motion is not None:
        check_source(config.motion.tracks, capture)
    # Every image is read here, so that bad input is refused before anything is written.
    run = Run(capture, out, config, model_config, chosen)
    with claimed(out, settings):
        state = run.last_good_state()
        if state.stage == "fine" and state.iteration == config.fine_iterations and run.model_path.exists():
            return run.model_path
        step = run.steps(state)
        if step:
            say(f"continuing at {state.stage} iteration {state.iteration} of {config.iterations(state.stage)}")
        history = History(out, step, tensorboard=tensorboard)
        try:
            run.train(state, progress, history, say)
        except NotFinite as found:
            raise InputError(run.diagnosis(state, found, say)) from None
        finally:
            history.close()
    return run.model_path


def model_config_of(capture: Capture, variant: dict[str, Any]) -> ModelConfig:
    """The model's settings for a capture; `variant` holds what differs from the defaults."""
    return ModelConfig(**{"temporal_resolution": temporal_resolution(len(capture.frames)), **variant})


def settings_of(capture: Capture, config: TrainingConfig, model_config: ModelConfig) -> dict[str, Any]:
    """What makes a run this one and no other: `config.json`."""
    training = dataclasses.asdict(config)
    if config.motion is None:  # as before there was such a setting
        del training["motion"], training["rates"]["tracks"], training["rates"]["heading"]
    return {
        "capture": str(capture.folder.resolve()),
        "capture_fingerprint": capture.fingerprint,
        "training": training,
        "model": dataclasses.asdict(model_config),
    }


class Run:
    """One training run: what stays fixed over it, and the loop."""

    def __init__(
        self,
        capture: Capture,
        out: Path,
        config: TrainingConfig,
        model_config: ModelConfig,
        device: torch.device | None = None,
    ) -> None:
        self.capture = capture
        self.out = out
        self.config = config
        self.model_config = model_config
        self.device = device or torch.device("cpu")
        self.model_path = out / "model.safetensors"
        self.checkpoint_path = out / "checkpoint.safetensors"
        self.frame: ModelFrame = frame_of(capture)
        indices = capture.of_split("train")
        images = torch.from_numpy(read_images(capture, indices))
        c = capture.camera
        self.views = [
            View(
                capture.frames[i].t,
                self.frame.camera(capture.frames[i].viewmat, c.K, c.width, c.height, self.device),
                image.to(self.device),
            )
            for i, image in zip(indices, images, strict=True)
        ]
        # What no anchor covers shows the mean colour of the training frames: the least wrong constant.
        self.background = (images.float().mean(dim=(0, 1, 2)) / 255).to(self.device)
        self.voxel = config.voxel_px / float(c.K[0, 0])
        self.pixel = 1 / float(c.K[0, 0])  # its width at unit depth
        self.tracks: Tracks | None = None  # once they are known

    def initial_state(self) -> TrainingState:
        # Drawn on the CPU, whatever the device. The anchors' draws depend on the variant; the model starts anew.
        torch.manual_seed(self.config.seed)
        c = self.model_config
        centres = voxel_centres(self.frame.to_model(self.capture.points), self.voxel)
        scale = spacing(centres, floor=1e-3 * self.voxel)
        anchors = Anchors(
            torch.from_numpy(centres).float(),
            torch.from_numpy(np.log(scale)).float()[:, None].repeat(1, 6),
            c.offsets,
            c.feature_dim,
            c.embedding_dim,
            embeddings=c.embeddings(),
            embedding_std=self.config.embedding_std,
        )
        torch.manual_seed(self.config.seed)
        model = AdaAnchor4D(c, anchors).to(self.device)
        optimiser = make_optimiser(model, self.config.rates, "coarse")
        statistics = Statistics.zeros(len(anchors), c.offsets, self.device)
        return TrainingState("coarse", 0, 0.0, model, optimiser, statistics, self._poses())

    def _poses(self) -> PoseRefinement | None:
        """The given poses as a start, where they are learned."""
        if not self.config.refine_poses:
            return None
        return PoseRefinement([view.camera for view in self.views], self.config.rates.poses)

    def last_good_state(self) -> TrainingState:
        """That of the checkpoint, or the initial one where there is none."""
        if not self.checkpoint_path.exists():
            return self.initial_state()
        c = self.config
        return load_checkpoint(self.checkpoint_path, self.model_config, c.rates, self.device, self._poses())

    def steps(self, state: TrainingState) -> int:
        """Iterations done over all stages."""
        return self.config.iterations_before(state.stage) + state.iteration

    def train(self, state: TrainingState, progress: Progress, history: History, say: Say = lambda _: None) -> None:
        """Raises NotFinite; `state` then tells in which iteration it was found."""
        self._know_movers(state)
        with stop_requests() as stop_requested:
            while True:
                self._stage(state, progress, history, stop_requested)
                if state.stage == "fine":
                    break
                self._leave_static(state, say)
        self._save(state, history)

    def _know_movers(self, state: TrainingState) -> None:
        """Tracks that a stage depends on, before it starts or continues."""
        motion = self.config.motion
        if motion is None:
            return
        if state.stage == "fine":
            self.tracks = self._own_tracks(tracks_path(self.out))
            groups = () if state.model.groups is None else state.model.groups.names
            if groups != self.tracks.names:
                raise InputError(f"{tracks_path(self.out)}: is of another run than the checkpoint beside it; {RESTART}")
        elif state.stage == "clean":
            self.tracks = self._own_tracks(movers_path(self.out))
        elif not motion.needs_static:
            self.tracks = truth_tracks(self.capture, self.capture.of_split("train"))

    def _own_tracks(self, path: Path) -> Tracks:
        tracks, c = load_tracks(path), self.capture.camera
        if tracks.labels.shape != (len(self.views), c.height, c.width):
            raise InputError(f"{path}: holds tracks of another capture; {RESTART}")
        return tracks

    def _leave_static(self, state: TrainingState, say: Say) -> None:
        """From the coarse to the clean stage, where movers were found that it has not seen; else to the fine stage."""
        motion = self.config.motion
        if motion is not None and motion.needs_static:
            check_finite(state.optimiser, "a parameter")
            started = time.perf_counter()
            self.tracks = find(motion.tracks, self.capture, *self.static_views(state.model), self.tracks)
            seconds = time.perf_counter() - started
            state.seconds += seconds
            say(f"tracks of movers after the {state.stage} stage: {len(self.tracks)}, in {seconds:.0f} s")
            if state.stage == "coarse" and self.config.iterations("clean") and len(self.tracks):
                save_tracks(movers_path(self.out), self.tracks)
                state.stage, state.iteration = "clean", 0
                state.optimiser = make_optimiser(state.model, self.config.rates, "clean")
                save_checkpoint(self.checkpoint_path, state)
                return
        if self.tracks is not None and not len(self.tracks):
            say("no mover was found: no anchor rides")
        self._enter_fine(state)

    @torch.no_grad()
    def static_views(self, model: AdaAnchor4D) -> tuple[FloatArray, FloatArray]:
        """What the static scene shows in place of the training frames: color [V, H, W, 3], depth_z in world units."""
        color, depth = [], []
        for view in self.views:
            rendered = render(model, None, view.camera, self.background, outputs=["depth"])
            rendering = rendered.rendering
            assert rendering.depth is not None
            color.append(rendering.color.clamp(0, 1).cpu().numpy())
            depth.append(rendering.depth.cpu().numpy() * np.float32(self.frame.unit_m))
        return np.stack(color), np.stack(depth)

    def _stage(self, state: TrainingState, progress: Progress, history: History, stop_requested: StopRequest) -> None:
        total = self.config.iterations(state.stage)
        while state.iteration < total:
            started = time.perf_counter()
            loss, psnr_db = self.step(state)
            state.iteration += 1
            state.seconds += time.perf_counter() - started
            anchors = len(state.model.anchors)
            history.add(self.steps(state), state.stage, state.iteration, loss, psnr_db, anchors, state.seconds)
            progress(state.stage, state.iteration, total, loss, psnr_db, anchors)
            if stop_requested():
                self._save(state, history)
                raise Interrupted(
                    f"stopped at {state.stage} iteration {state.iteration} of {total}; {self.out} is usable as it is, "
                    "and the same command continues from there"
                )
            if state.iteration % self.config.checkpoint_every == 0 and state.iteration < total:
                self._save_checkpoint(state, history)

    def step(self, state: TrainingState, watch: Watch | None = None) -> tuple[float, float]:
        """One iteration on one view; returns loss and PSNR of that view.

        Raises:
            NotFinite: what is drawn or the loss is not finite, or `watch` says so of a gradient or a parameter.
        """
        index = self._view_index(state.stage, state.iteration)
        view, poses = self.views[index], state.poses
        if poses is not None:
            view = dataclasses.replace(view, camera=poses.camera(index, view.camera))
        model, optimiser = state.model, state.optimiser
        set_rates(optimiser, state.iteration / max(self.config.iterations(state.stage) - 1, 1), self._resting(state))
        rendered = self._render(state, view)
        target = view.target()
        if self.tracks is not None and state.stage != "fine":
            # Where something moves the static scene is asked for nothing: its own picture has no gradient.
            moving = torch.from_numpy(self.tracks.moving[index]).to(self.device)
            target = torch.where(moving[..., None], rendered.rendering.color.detach(), target)
        loss, squared_error = self._loss(model, state.stage, rendered, target)
        share = rendered.rendering.features
        if share is not None and self.tracks is not None and (motion := self.config.motion) is not None:
            labels = torch.from_numpy(self.tracks.labels[index] > 0).to(self.device)
            moving = torch.from_numpy(self.tracks.moving[index]).to(self.device)
            loss = loss + motion.membership * membership_loss(share[..., 0], labels, moving)
        value = loss.item()
        if not math.isfinite(value):
            raise NotFinite("the loss")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if watch:
            watch(optimiser, "a gradient")
        optimiser.step()
        if model.groups is not None and (motion := self.config.motion) is not None:
            model.groups.bound(motion.farthest_px * self.pixel, motion.largest_turn)
        if poses is not None:
            poses.step(self.steps(state) / self.config.total_iterations)
            if (state.iteration + 1) % len(self.views) == 0:
                poses.fix_gauge()
        if watch:
            watch(optimiser, "a parameter")
        with torch.no_grad():
            seed = (self.config.seed, STAGE_SEEDS[state.stage])
            if state.stage != "clean":
                rider_voxel = self.config.motion.voxel_px * self.pixel if self.config.motion is not None else 0.0
                densify(state, self.config.densification, rendered, self.voxel, seed, rider_voxel)
        return value, decibels(squared_error.item())

    def _resting(self, state: TrainingState) -> tuple[str, ...]:
        """Parameter groups that do not learn yet."""
        motion = self.config.motion
        early = motion is not None and state.iteration < motion.learn_from * self.config.fine_iterations
        return ("tracks", "heading") if early else ()

    def _render(self, state: TrainingState, view: View) -> Rendered:
        try:
            t = view.t if state.stage == "fine" else None
            return render(state.model, t, view.camera, self.background, anchor_features=self._membership(state.model))
        except ValueError as error:  # the rasteriser draws no NaN; it names the tensor
            raise NotFinite(f"what it draws ({error})") from None

    def _membership(self, model: AdaAnchor4D) -> Tensor | None:
        """[N, 1] what is drawn to compare riders with the movers' masks: 1 for an anchor that rides."""
        motion, group = self.config.motion, model.anchors.group
        if motion is None or motion.membership == 0 or group is None:
            return None
        return (group >= 0).float()[:, None]

    def _view_index(self, stage: str, iteration: int) -> int:
        """Every view once an epoch, in an order drawn from (seed, stage, epoch)."""
        epoch, position = divmod(iteration, len(self.views))
        order = np.random.default_rng([self.config.seed, STAGE_SEEDS[stage], epoch]).permutation(len(self.views))
        return int(order[position])

    def _loss(self, model: AdaAnchor4D, stage: str, rendered: Rendered, target: Tensor) -> tuple[Tensor, Tensor]:
        """The loss, and the squared error of the image."""
        weights, rendering = self.config.loss, rendered.rendering
        loss, squared_error = image_loss(rendering.color, target, weights.dssim)
        drawn = (rendering.radii > 0).float()
        x, y, z = rendered.gaussians.scales.unbind(1)  # the gradient of prod() takes ten times as long
        volume = (x * y * z * drawn).sum() / drawn.sum().clamp_min(1)
        loss = loss + weights.volume * volume
        if stage == "fine":
            # Where anchors ride, their settings say how calm the field is.
            motion = self.config.motion if model.groups is not None else None
            time = motion or weights
            loss = loss + regularisation(
                model.field, weights.plane_smoothness, time.time_smoothness, time.time_constancy
            )
        return loss, squared_error

    def _enter_fine(self, state: TrainingState) -> None:
        """Build DACW and the field's box from the anchors of the coarse stage, and start a new optimiser."""
        check_finite(state.optimiser, "a parameter")
        model, w = state.model, self.config.warp
        position = model.anchors.position
        model.field.box.copy_(torch.stack([position.amin(0), position.amax(0)]))
        if self.model_config.dacw:
            u = model.field.normalise(position)
            model.warp.boundaries.copy_(
                density_adaptive_boundaries(u, self.model_config.bins, w.smoothing, w.gamma, w.lambda_min, w.lambda_max)
            )
        self._save_model(state, self.out / "coarse.safetensors")
        if self.config.motion is not None and self.tracks is not None:
            save_tracks(tracks_path(self.out), self.tracks)
            if len(self.tracks):
                voxel = self.config.motion.voxel_px * self.pixel
                torch.manual_seed(self.config.seed)
                add_riders(model, self.capture, self.tracks, self.frame, voxel, self.config.embedding_std)
        state.stage, state.iteration = "fine", 0
        state.optimiser = make_optimiser(model, self.config.rates, "fine")
        state.statistics = Statistics.zeros(len(model.anchors), self.model_config.offsets, self.device)
        save_checkpoint(self.checkpoint_path, state)

    def _save(self, state: TrainingState, history: History) -> None:
        """The model first: where the checkpoint says that training is over, the model file is the final one."""
        check_finite(state.optimiser, "a parameter")
        self._save_model(state, self.model_path)
        self._save_checkpoint(state, history)

    def _save_checkpoint(self, state: TrainingState, history: History) -> None:
        """Only ever over the last one with finite values: it is what a diverged run goes back to."""
        check_finite(state.optimiser, "a parameter")
        image = target = None
        if history.wants_images:
            with torch.no_grad():
                image, target = self._render(state, self.views[0]).rendering.color, self.views[0].target()
        history.write(self.steps(state), image, target)
        save_checkpoint(self.checkpoint_path, state)

    def _save_model(self, state: TrainingState, path: Path) -> None:
        training: dict[str, Any] = {
            "preset": self.config.preset,
            "seed": self.config.seed,
            "iterations": state.iteration,
            "seconds": round(state.seconds, 3),
            "capture_fingerprint": self.capture.fingerprint,
        }
        if (poses := state.poses) is not None:
            training["refined_poses"] = True
        background = tuple(float(c) for c in self.background)
        save_model(
            path,
            state.model,
            stage="fine" if state.stage == "fine" else "coarse",
            capture=self.capture if poses is None else refined(self.capture, self.frame, poses.values()),
            frame=self.frame,
            background=(background[0], background[1], background[2]),
            training=training,
        )

    def diagnosis(self, state: TrainingState, found: NotFinite, say: Say) -> str:
        """Repeat the iterations since the last checkpoint with a check in each: on the CPU they are the same bits."""
        at, where = self.steps(state), f"{state.stage} iteration {state.iteration + 1}"
        if found.what == "a parameter":
            at, where = at - 1, f"{state.stage} iteration {state.iteration}"  # found once that iteration was over
        again = self.last_good_state()
        self._know_movers(again)
        say(f"{found.what} is not finite at {where}; repeating {at - self.steps(again) + 1} iterations to see why")
        try:
            while self.steps(again) <= at:
                if again.stage != "fine" and again.iteration == self.config.iterations(again.stage):
                    break  # the fine stage starts with a checkpoint: what follows would be another run
                self.step(again, check_finite)
                again.iteration += 1
        except NotFinite as first:
            found, where = first, f"{again.stage} iteration {again.iteration + 1}"
        groups = f" of {', '.join(repr(name) for name in found.groups)}" if found.groups else ""
        kept = f"{self.checkpoint_path} is the last good state" if self.checkpoint_path.exists() else "nothing is kept"
        return (
            f"{self.out}: training first met NaN or infinity in {found.what}{groups} at {where}; "
            f"{advice(found.groups)}; {kept}"
        )

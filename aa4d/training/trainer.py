"""The loop over stages: it trains any method, and knows none by name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture
from aa4d.device import DeviceName, choose_device
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.image_metrics import decibels
from aa4d.field.mlp import use_arithmetic
from aa4d.files import write_text
from aa4d.interrupts import StopRequest, interrupted_at_once, stop_requests
from aa4d.methods import method_of
from aa4d.methods.contract import Look, Stage
from aa4d.methods.model_file import save_model
from aa4d.methods.rendering import Rendered, render
from aa4d.methods.settings import RunSettings
from aa4d.raster.types import Output
from aa4d.settings.toml import as_toml
from aa4d.training.checkpoints import TrainingState, load_checkpoint, save_checkpoint
from aa4d.training.depth import depth_loss
from aa4d.training.exposures import Exposures, with_exposures
from aa4d.training.frames import TrainingFrames, View, training_frames
from aa4d.training.history import History
from aa4d.training.movers import Movers
from aa4d.training.optimiser import edit_units, make_optimiser, set_rates
from aa4d.training.poses import PoseRefinement, refined
from aa4d.training.riding import check_source, refuse_idle_rates
from aa4d.training.run_folder import check_folder, claimed, run_identity, run_settings, what_counts
from aa4d.training.schedule import CLEAN, Schedule, schedule_of
from aa4d.training.spent import Spent
from aa4d.training.watchdog import NotFinite, Watch, advice, check_finite

HEADING = "The settings of this run; `aa4d train CAPTURE --out RUN --config settings.toml` takes the same."

# What the trainer tells whoever watches, once an iteration: stage, iteration, total, loss, PSNR in dB, units.
Progress = Callable[[str, int, int, float, float, int], None]
# And now and then, in a sentence.
Say = Callable[[str], None]


def train(
    capture: Capture,
    out: Path,
    settings: RunSettings,
    progress: Progress,
    *,
    device: DeviceName = "auto",
    tensorboard: bool = False,
    say: Say = lambda _: None,
) -> Path:
    """Train, or continue a run that was stopped or killed; a finished run is left as it is.

    Writes `config.json`, `history.csv`, `checkpoint.safetensors`, `coarse.safetensors` and `model.safetensors` into
    `out`.

    Returns:
        The path of the model file.

    Raises:
        InputError: `out` holds something else, the capture cannot be read, the device is not there, or the training
            met NaN or infinity: the last checkpoint is then the last good one.
        Interrupted: Ctrl-C; the checkpoint and a usable model file of that moment are written.
    """
    chosen = choose_device(device)
    given = as_toml(settings, HEADING, {"method": settings.method})
    settings = method_of(settings.method).resolved(settings, len(capture.frames))
    description = description_of(capture, settings)
    check_folder(out, description)
    check_content(capture.folder)
    if settings.motion is None:
        refuse_idle_rates(settings.rates)
    else:
        check_source(settings.motion.tracks, capture)
    # Every image is read here, so that bad input is refused before anything is written.
    frames = training_frames(capture, chosen, with_masks=settings.leave_out, with_depth=settings.true_depth > 0)
    run = Run(frames, out, settings)
    with claimed(out, description):
        write_text(out / "settings.toml", given)
        state = run.last_good_state()
        if run.is_finished(state):
            return run.model_path
        if step := run.steps(state):
            total = run.schedule[state.stage].iterations
            say(f"continuing at {state.stage} iteration {state.iteration} of {total}")
        history = History(out, step, tensorboard=tensorboard)
        try:
            run.train(state, progress, history, say)
        except NotFinite as found:
            raise InputError(run.diagnosis(state, found, say)) from None
        finally:
            history.close()
    return run.model_path


def description_of(capture: Capture, settings: RunSettings) -> dict[str, Any]:
    """What makes a run this one and no other: `config.json`. The settings may be resolved already."""
    training = what_counts(method_of(settings.method).resolved(settings, len(capture.frames)))
    model = training.pop("model", {})
    return run_settings(capture, settings.method, training, model)


class Run:
    """One training run: what stays fixed over it, and the loop."""

    def __init__(self, frames: TrainingFrames, out: Path, settings: RunSettings) -> None:
        """`settings` are resolved (`Method.resolved`)."""
        self.frames = frames
        self.out = out
        self.settings = settings
        self.method = method_of(settings.method)
        self.schedule: Schedule = schedule_of(settings)
        self.movers = None if settings.motion is None else Movers(settings.motion, frames, out)
        self.model_path = out / "model.safetensors"
        self.checkpoint_path = out / "checkpoint.safetensors"
        self.identity = run_identity(description_of(frames.capture, settings))

    def initial_state(self) -> TrainingState:
        # Drawn on the CPU, whatever the device.
        model = self.method.initial(self.settings, self.frames.beginning()).to(self.frames.device)
        use_arithmetic(model, self.settings.arithmetic)
        first = self.schedule.stages[0]
        optimiser = make_optimiser(model, self.settings.rates, canonical=first.canonical)
        statistics = Statistics.zeros(len(model), model.per_unit, self.frames.device)
        return TrainingState(first.name, 0, Spent(), model, optimiser, statistics, self._poses(), self._exposures())

    def _poses(self) -> PoseRefinement | None:
        """The given poses as a start, where they are learned."""
        if not self.settings.refine_poses:
            return None
        return PoseRefinement([view.camera for view in self.frames.views], self.settings.rates.poses)

    def _exposures(self) -> Exposures | None:
        """None but where they are learned."""
        if not self.settings.exposure:
            return None
        return Exposures(len(self.frames.views), self.settings.rates.exposures, self.frames.device)

    def last_good_state(self) -> TrainingState:
        """That of the checkpoint, or the initial one where there is none."""
        if not self.checkpoint_path.exists():
            return self.initial_state()
        own, device = self.identity.digest(), self.frames.device
        poses, exposures = self._poses(), self._exposures()
        state = load_checkpoint(self.checkpoint_path, self.settings, device, poses, exposures, run=own)
        use_arithmetic(state.model, self.settings.arithmetic)
        return state

    def is_finished(self, state: TrainingState) -> bool:
        last = self.schedule.stages[-1]
        return state.stage == last.name and state.iteration == last.iterations and self.model_path.exists()

    def steps(self, state: TrainingState) -> int:
        """Iterations done over all stages."""
        return self.schedule.iterations_before(state.stage) + state.iteration

    def train(self, state: TrainingState, progress: Progress, history: History, say: Say = lambda _: None) -> None:
        """Raises NotFinite; `state` then tells in which iteration it was found."""
        self._know_movers(state)
        with stop_requests() as stop_requested:
            self._stage(state, progress, history, stop_requested)
            history.write(self.steps(state))  # a killed run goes on from the next stage's first checkpoint
            while self._next_stage(state, history, say):
                self._stage(state, progress, history, stop_requested)
                history.write(self.steps(state))
        self._save(state, history)

    def _know_movers(self, state: TrainingState) -> None:
        if self.movers is not None:
            stage = self.schedule[state.stage]
            self.movers.know(state.model, moving=not stage.canonical, clean=stage.name == CLEAN)

    def _next_stage(self, state: TrainingState, history: History, say: Say) -> bool:
        """Enter the stage that follows; False after the last. Without movers nothing is to be cleaned of them.

        Raises:
            Interrupted: a signal during the search for movers, which takes minutes; the stage before it is saved.
        """
        following = self.schedule.after(state.stage)
        if following is None:
            return False
        check_finite(state.optimiser, "a parameter")
        movers, first_moving = self.movers, self.schedule.first_moving
        if movers is not None and movers.settings.needs_static and following.name in (CLEAN, first_moving.name):
            self._save_checkpoint(state, history)
            try:
                with interrupted_at_once():
                    state.spent += movers.look(state.model, state.exposures, state.stage, say)
            except KeyboardInterrupt:
                raise Interrupted("stopped while looking for movers; the same command looks again") from None
            assert movers.tracks is not None
            if following.name == CLEAN and len(movers.tracks):
                movers.keep_first_look()
            elif following.name == CLEAN:
                following = first_moving
        self.enter(state, following, say)
        return True

    def enter(self, state: TrainingState, stage: Stage, say: Say = lambda _: None) -> None:
        """Start a stage with a new optimiser; its first checkpoint is written."""
        model = state.model
        self.method.enter(stage, model, self.settings)
        if stage is self.schedule.first_moving:
            self.write_model(state, self.out / "coarse.safetensors")
            if self.movers is not None:
                self.movers.ride(model, self.settings, say)
        state.stage, state.iteration = stage.name, 0
        state.optimiser = make_optimiser(model, self.settings.rates, canonical=stage.canonical)
        state.statistics = Statistics.zeros(len(model), model.per_unit, self.frames.device)
        save_checkpoint(self.checkpoint_path, state, self.identity.digest())

    def _stage(self, state: TrainingState, progress: Progress, history: History, stop_requested: StopRequest) -> None:
        total = self.schedule[state.stage].iterations
        while state.iteration < total:
            started = Spent.clocks()
            loss, psnr_db = self.step(state)
            state.iteration += 1
            state.spent += Spent.clocks().since(started)
            units = len(state.model)
            history.add(self.steps(state), state.stage, state.iteration, loss, psnr_db, units, state.spent.seconds)
            progress(state.stage, state.iteration, total, loss, psnr_db, units)
            if stop_requested():
                self._save(state, history)
                raise Interrupted(
                    f"stopped at {state.stage} iteration {state.iteration} of {total}; {self.out} is usable as it is, "
                    "and the same command continues from there"
                )
            if state.iteration % self.settings.checkpoint_every == 0 and state.iteration < total:
                self._save_checkpoint(state, history)

    def step(self, state: TrainingState, watch: Watch | None = None) -> tuple[float, float]:
        """One iteration; returns loss and PSNR of its views.

        Raises:
            NotFinite: what is drawn or the loss is not finite, or `watch` says so of a gradient or a parameter.
        """
        stage, model, optimiser, movers = self.schedule[state.stage], state.model, state.optimiser, self.movers
        resting = movers.resting(state.iteration, self.settings.fine_iterations) if movers is not None else ()
        set_rates(optimiser, stage.progress(state.iteration), resting)
        self.method.begin_step(stage, state.iteration, model, self.settings)
        drawn, losses, squared_errors = [], [], []
        for index in self._view_indices(stage, state.iteration):
            rendered, loss, squared_error = self._view_loss(state, stage, index)
            drawn.append(rendered)
            losses.append(loss)
            squared_errors.append(squared_error)
        loss = losses[0] if len(losses) == 1 else torch.stack(losses).mean()
        if (penalty := self.method.penalty(stage, model, self.settings)) is not None:
            loss = loss + penalty
        value = loss.item()
        if not math.isfinite(value):
            raise NotFinite("the loss")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if watch:
            watch(optimiser, "a gradient")
        optimiser.step()
        if movers is not None:
            movers.bound(model)
        for learned in state.per_view:
            learned.step(self.steps(state) / self.schedule.total)
            if (state.iteration + 1) % len(self.frames.views) == 0:
                learned.fix_gauge()
        if watch:
            watch(optimiser, "a parameter")
        self._change_units(state, stage, drawn)
        done = state.iteration + 1
        if edit := self.method.revise(stage, done, model, self.settings, lambda: self._looks(state)):
            state.statistics = edit_units(model, optimiser, state.statistics, edit)
        return value, decibels(sum(error.item() for error in squared_errors) / len(squared_errors))

    def _view_loss(self, state: TrainingState, stage: Stage, index: int) -> tuple[Rendered, Tensor, Tensor]:
        """What is drawn of a view, its loss, and the squared error of the image."""
        view, movers = self.frames.views[index], self.movers
        if state.poses is not None:
            view = dataclasses.replace(view, camera=state.poses.camera(index, view.camera))
        t = self.method.trained_time(stage, state.iteration, view.t, len(self.frames.views), self.settings)
        outputs = {*self.method.outputs(self.settings)} if self._gathers(stage, state.iteration + 1) else set()
        if view.depth is not None:
            outputs.add("depth")
        rendered = self._render(state, dataclasses.replace(view, t=t), outputs)
        if state.exposures is not None:
            rendered = state.exposures.of(index, rendered)
        target, ignored = view.target(), self._ignored(stage, view, index)
        if ignored is not None:  # its own picture has no gradient
            target = torch.where(ignored[..., None], rendered.rendering.color.detach(), target)
        loss, squared_error = self.method.image_loss(rendered, target, self.settings)
        if view.depth is not None:
            loss = loss + self.settings.true_depth * depth_loss(rendered.rendering.depth, view.depth, ignored)
        if movers is not None and (of_movers := movers.loss(rendered, index)) is not None:
            loss = loss + of_movers
        return rendered, loss, squared_error

    def _ignored(self, stage: Stage, view: View, index: int) -> Tensor | None:
        """Pixels [H, W] of a view of which nothing is asked: those left out, and movers while the scene is static."""
        movers = self.movers
        if movers is None or movers.tracks is None or not stage.canonical:
            return view.left_out
        moving = movers.moving(index)
        return moving if view.left_out is None else moving | view.left_out

    @torch.no_grad()
    def _change_units(self, state: TrainingState, stage: Stage, drawn: list[Rendered]) -> None:
        """After the backward pass of the iteration that makes `state.iteration` + 1."""
        d, done, settings = self.settings.densification, state.iteration + 1, self.settings
        if not self._gathers(stage, done):
            return
        for rendered in drawn:
            self.method.observe(state.statistics, rendered, len(drawn), settings)
        if done <= d.start or done % d.interval:
            return
        # The stage and the iteration make the random choices, so that a checkpoint keeps none.
        seed = int(np.random.SeedSequence([settings.seed, stage.draws, done]).generate_state(1)[0])
        generator = torch.Generator().manual_seed(seed)
        edit = self.method.edit(state.model, state.statistics, settings, self.frames.pixel, generator)
        state.statistics = edit_units(state.model, state.optimiser, state.statistics, edit)

    def _gathers(self, stage: Stage, done: int) -> bool:
        """Whether the iteration that makes `done` of a stage counts for growing."""
        d = self.settings.densification
        return stage.changes_units and d.statistics_from < done <= d.until

    def _looks(self, state: TrainingState) -> list[Look]:
        cameras = [view.camera for view in self.frames.views]
        if (poses := state.poses) is not None:
            cameras = [poses.camera(index, camera) for index, camera in enumerate(cameras)]
        times = [view.t for view in self.frames.views]
        return [Look(t, camera, self.frames.background) for t, camera in zip(times, cameras, strict=True)]

    def _render(self, state: TrainingState, view: View, outputs: Collection[Output] = ()) -> Rendered:
        try:
            t = None if self.schedule[state.stage].canonical else view.t
            features = None if self.movers is None else self.movers.membership(state.model)
            background = self.frames.background
            return render(state.model, t, view.camera, background, outputs=outputs, unit_features=features)
        except ValueError as error:  # the rasteriser draws no NaN; it names the tensor
            raise NotFinite(f"what it draws ({error})") from None

    def _view_indices(self, stage: Stage, iteration: int) -> list[int]:
        """The views of a step: every view of the stage once an epoch, in an order drawn from (seed, stage, epoch)."""
        usable = [i for i, view in enumerate(self.frames.views) if stage.looks_at(view.t)]
        usable = usable or list(range(len(self.frames.views)))  # a clip may be too short to have any there
        count, chosen = len(usable), []
        for number in range(iteration * stage.views_per_step, (iteration + 1) * stage.views_per_step):
            epoch, position = divmod(number, count)
            order = np.random.default_rng([self.settings.seed, stage.draws, epoch]).permutation(count)
            chosen.append(usable[order[position]])
        return chosen

    def _save(self, state: TrainingState, history: History) -> None:
        """The model first: where the checkpoint says that training is over, the model file is the final one."""
        check_finite(state.optimiser, "a parameter")
        self.write_model(state, self.model_path)
        self._save_checkpoint(state, history)

    def _save_checkpoint(self, state: TrainingState, history: History) -> None:
        """Only ever over the last one with finite values: it is what a diverged run goes back to."""
        check_finite(state.optimiser, "a parameter")
        image = target = None
        if history.wants_images:
            with torch.no_grad():
                view = self.frames.views[0]
                image, target = self._render(state, view).rendering.color, view.target()
        history.write(self.steps(state), image, target)
        save_checkpoint(self.checkpoint_path, state, self.identity.digest())

    def write_model(self, state: TrainingState, path: Path) -> None:
        """The model of a moment, as a file that every command reads."""
        capture = self.frames.capture
        training: dict[str, Any] = {
            "preset": self.settings.preset,
            "seed": self.settings.seed,
            "iterations": state.iteration,
            "seconds": round(state.spent.seconds, 3),
            "processor_seconds": round(state.spent.processor_seconds, 3),
        }
        if state.poses is not None:
            training["refined_poses"] = True
            capture = refined(capture, self.frames.frame, state.poses.values())
        if state.exposures is not None:
            capture = with_exposures(capture, state.exposures.values())
        red, green, blue = (float(c) for c in self.frames.background)
        save_model(
            path,
            self.method.name,
            state.model,
            is_static=self.schedule[state.stage].canonical,
            capture=capture,
            frame=self.frames.frame,
            background=(red, green, blue),
            training=training,
            run=self.identity,
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
                stage = self.schedule[again.stage]
                if again.iteration == stage.iterations and self.schedule.after(stage.name) is not None:
                    break  # the next stage starts with a checkpoint: what follows would be another run
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

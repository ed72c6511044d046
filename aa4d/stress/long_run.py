"""A long training on a hostile capture, with what loss and parameters did meanwhile.

    python -m aa4d.stress.long_run --out DIR

Stopped at any time, it continues. DIR/rows.json has the rows that docs/hard-cases.md shows, DIR/long-run.png its plot:

    python -m aa4d.experiments.documents record long-run DIR/rows.json --load LOAD
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import torch
from matplotlib.figure import Figure
from torch.optim import Adam
from tyro.conf import arg

from aa4d.capture.reader import read_capture
from aa4d.capture.writing import INDEX
from aa4d.errors import InputError
from aa4d.experiments.program import run_as_program
from aa4d.files import make_folder, read_json_object, whole_file, write_json
from aa4d.methods import method_of
from aa4d.methods.adaanchor4d.settings import PRESETS
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.methods.rendering import render
from aa4d.methods.settings import MotionSettings, RunSettings, with_iterations
from aa4d.stress.hostile import write_hostile_capture
from aa4d.training.frames import training_frames
from aa4d.training.history import History
from aa4d.training.run_folder import check_folder, claimed
from aa4d.training.trainer import Run, description_of
from aa4d.training.watchdog import NotFinite

EVERY = 100  # iterations from one look at the parameters to the next
CANONICAL_SHARE = 0.1  # of the iterations
MOST_ANCHORS = 1500
SHOWN_ROWS = 12
COLORS = 10  # of matplotlib, after which they repeat


class Norms:
    """Rows of loss and parameter norms, one every `EVERY` iterations; a run that continues keeps its rows."""

    def __init__(self, path: Path, step: int) -> None:
        self._path = path
        before = read_json_object(path, "the norms of a long run")["rows"] if path.exists() else []
        self.rows: list[dict[str, Any]] = [row for row in before if row["step"] <= step]
        self._losses: list[float] = []

    def add(self, step: int, loss: float, psnr_db: float, anchors: int, optimiser: Adam) -> None:
        """Raises NotFinite."""
        self._losses.append(loss)
        if step % EVERY:
            return
        groups = {group["name"]: norms_of(group["params"]) for group in optimiser.param_groups}
        if wrong := tuple(name for name, norms in groups.items() if not math.isfinite(norms["largest"])):
            raise NotFinite("a parameter", wrong)
        mean, largest = sum(self._losses) / len(self._losses), max(self._losses)
        self.rows.append(
            {"step": step, "loss": mean, "largest_loss": largest, "psnr_db": psnr_db, "anchors": anchors}
            | {"groups": groups}
        )
        self._losses.clear()
        write_json(self._path, {"rows": self.rows})


def norms_of(parameters: list[torch.Tensor]) -> dict[str, float]:
    """Root mean square and largest magnitude of all values; of none 0."""
    values = torch.cat([parameter.detach().reshape(-1) for parameter in parameters]).double()
    if not len(values):
        return {"rms": 0.0, "largest": 0.0}
    return {"rms": float(values.square().mean().sqrt()), "largest": float(values.abs().max())}


def settings_of(iterations: int, seed: int) -> RunSettings:
    """The paper's, over so many iterations, with anchors that ride."""
    motion = MotionSettings()
    canonical = max(round(CANONICAL_SHARE * iterations) - motion.clean_iterations, 1)
    moving = max(iterations - canonical - motion.clean_iterations, 1)
    paper = with_iterations(replace(PRESETS["paper"], motion=motion, seed=seed), canonical, moving)
    return replace(paper, densification=replace(paper.densification, max_anchors=MOST_ANCHORS))


def train(out: Path, settings: RunSettings) -> list[dict[str, Any]]:
    """Train in `out`/run on the capture in `out`/capture, or go on; returns the rows of `Norms`.

    Raises:
        InputError: a value was not finite, or the folder holds something else. Interrupted: Ctrl-C.
    """
    capture = read_capture(out / "capture")
    settings = method_of(settings.method).resolved(settings, len(capture.frames))
    description = description_of(capture, settings)
    check_folder(out / "run", description)
    run = Run(training_frames(capture, torch.device("cpu")), out / "run", settings)
    with claimed(run.out, description):
        state = run.last_good_state()
        step = run.steps(state)
        norms, history = Norms(out / "norms.json", step), History(run.out, step, tensorboard=False)

        def progress(stage: str, iteration: int, total: int, loss: float, psnr_db: float, anchors: int) -> None:
            norms.add(run.steps(state), loss, psnr_db, anchors, state.optimiser)
            if iteration % 1000 == 0:
                print(f"{stage} {iteration}/{total}  loss {loss:.4f}  {psnr_db:.1f} dB  {anchors} anchors", flush=True)

        if not run.is_finished(state):
            try:
                run.train(state, progress, history, lambda sentence: print(sentence, flush=True))
            except NotFinite as found:
                raise InputError(run.diagnosis(state, found, print)) from None
    return norms.rows


@torch.no_grad()
def check_pictures(loaded: LoadedModel) -> None:
    """Raises InputError where a frame of the clip is drawn with a value that is not finite."""
    background = torch.tensor(loaded.background)
    for frame in loaded.frames:
        camera = loaded.frame.camera(frame.viewmat, loaded.camera.K, loaded.camera.width, loaded.camera.height)
        if not torch.isfinite(render(loaded.model, frame.t, camera, background).rendering.color).all():
            raise InputError(f"{loaded.path}: frame {frame.name} is drawn with NaN or infinity")


def figure_of(rows: list[dict[str, Any]]) -> Figure:
    """Loss over the iterations, and the largest magnitude in each parameter group."""
    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    steps = [row["step"] for row in rows]
    for key, label in (("loss", "mean"), ("largest_loss", "largest")):
        above.plot(steps, [row[key] for row in rows], label=f"{label} of {EVERY} iterations")
    above.set(ylabel="loss", yscale="log")
    above.legend(fontsize=8)
    names = dict.fromkeys(name for row in rows for name in row["groups"])
    for number, name in enumerate(names):
        found = [(row["step"], row["groups"][name]["largest"]) for row in rows if name in row["groups"]]
        below.plot(*zip(*found, strict=True), "--" if number >= COLORS else "-", label=name)
    below.set(xlabel="iteration", ylabel="largest magnitude", yscale="log")
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8)
    for axes in (above, below):
        axes.grid(alpha=0.3)
    return figure


def long_run(
    out: Annotated[Path, arg(help="Folder for the capture, the run and its figures.")],
    iterations: Annotated[int, arg(help="Over all stages.")] = 30_000,
    seed: Annotated[int, arg(help="Of the training.")] = 0,
) -> None:
    """Train on a hostile capture, and show what loss and parameters did."""
    if not 1000 <= iterations <= 1_000_000:
        raise InputError(f"--iterations {iterations}: must be from 1000 to 1000000")
    torch.set_num_threads(1)  # a small problem, which a second thread slows down
    make_folder(out / "capture")
    if not (out / "capture" / INDEX).exists():
        write_hostile_capture(out / "capture")
    rows = train(out, settings_of(iterations, seed))
    check_pictures(load_model(out / "run" / "model.safetensors"))
    every = max(len(rows) // SHOWN_ROWS, 1)
    write_json(out / "rows.json", {"rows": rows[every - 1 :: every]})
    with whole_file(out / "long-run.png") as temporary:
        figure_of(rows).savefig(temporary, format="png", dpi=100)


if __name__ == "__main__":
    run_as_program(long_run)

"""The stages of `aa4d demo`, as one kind of task: what each makes, in the demo's folder, from what those before made.

Each is a dataclass of its settings with `about`, a line for people, `outputs`, of the demo's folder, and `make`.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.blender import run_forwarding_interrupts, run_in_blender, script
from aa4d.capture.reader import read_capture
from aa4d.evaluation.evaluate import evaluate
from aa4d.experiments.kinds.train import fit
from aa4d.export import export
from aa4d.export.clip import Clip
from aa4d.files import read_json_object, write_json
from aa4d.filming.camera_path import path_of_frames
from aa4d.graph.call import Call
from aa4d.graph.child import run_child
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location
from aa4d.methods.model_file import copy_model, load_model
from aa4d.methods.settings import RunSettings
from aa4d.reports.demo_report import write_report
from aa4d.training.run_folder import what_counts

CAPTURE, RUN, PAPER = "capture", "run", "paper"
MODEL, METRICS, PAGE, REPORT = "model.safetensors", "metrics.json", "page/scene.html", "report.html"
EXTENSION, BLEND, PICTURE = "adaanchor4d.zip", "flyover.blend", "flyover.png"


def metrics_of(folder: Path) -> dict[str, Any]:
    return read_json_object(folder / METRICS, "the metrics of an evaluation")


@dataclass(frozen=True)
class Synthesis:
    scene: str  # digest of the scene file, of what it names and of synth/
    path: Path = location()
    outputs = (CAPTURE,)

    @property
    def about(self) -> str:
        return f"Blender renders {self.path}"

    def make(self, call: Call) -> None:
        arguments = (str(self.path), "--out", str(call.folder / CAPTURE))
        run_child(
            call,
            lambda hear: run_in_blender("synth/render_flyover.py", *arguments, hear=hear),
            f"rendering {self.path}",
        )


@dataclass(frozen=True)
class Training:
    counts: dict[str, Any]  # of the settings: those that tell this run from others
    run: str  # folder
    settings: RunSettings = location()

    @staticmethod
    def of(settings: RunSettings, run: str) -> Training:
        return Training(what_counts(settings), run, settings)

    @property
    def about(self) -> str:
        return "coarse, then fine stage" if self.run == RUN else "the paper's model, for comparison"

    @property
    def outputs(self) -> tuple[str, ...]:
        return (MODEL,) if self.run == RUN else (f"{self.run}/{MODEL}",)

    def make(self, call: Call) -> None:
        run = call.folder / self.run
        fit(replace(call, folder=run), read_capture(call.folder / CAPTURE), self.settings)
        if self.run == RUN:
            copy_model(run / MODEL, call.folder / MODEL)


@dataclass(frozen=True)
class Evaluation:
    runs: tuple[str, ...]  # folders, the demo's own first
    about = "held-out frames against truth"
    outputs = (METRICS,)

    def make(self, call: Call) -> None:
        for run in self.runs:
            evaluate(call.folder / run, call.folder / CAPTURE, call.advance)
        write_json(call.folder / METRICS, metrics_of(call.folder / self.runs[0]))


@dataclass(frozen=True)
class Page:
    about = "a page that plays the scene in a browser"
    outputs = (PAGE,)

    def make(self, call: Call) -> None:
        loaded, folder = load_model(call.folder / MODEL), (call.folder / PAGE).parent
        if folder.exists():  # of another model: an export is never written over
            shutil.rmtree(folder)
        said = export(Clip(loaded, path_of_frames(loaded, "all"), None), "html", folder, call.advance)
        if said is not None:
            call.say(said)


@dataclass(frozen=True)
class Extension:
    sources: str  # digest of addon/
    about = "packaging the Blender extension"
    outputs = (EXTENSION,)

    def make(self, call: Call) -> None:
        command = [sys.executable, str(script("addon/build_extension.py")), str(call.folder / EXTENSION)]
        run_child(call, lambda hear: run_forwarding_interrupts(command, hear), "packaging the extension")


@dataclass(frozen=True)
class Blend:
    about = "Blender imports the model and renders a frame"
    outputs = (BLEND, PICTURE)

    def make(self, call: Call) -> None:
        # The local Gaussians make the better picture; in the file they lie beside the anchors, hidden in the viewport.
        options = {"--extension": EXTENSION, "--out": BLEND, "--render": PICTURE}
        arguments = [part for option, name in options.items() for part in (option, str(call.folder / name))]
        arguments = [str(call.folder / MODEL), *arguments, "--gaussians"]
        run_child(
            call,
            lambda hear: run_in_blender("addon/make_flyover_blend.py", *arguments, hear=hear),
            "importing the model",
        )


@dataclass(frozen=True)
class Report:
    """It tells how long every other stage took."""

    runs: tuple[str, ...]  # as of an evaluation
    about = "pictures and tables"
    outputs = (REPORT,)

    def make(self, call: Call) -> None:
        run, *others = (call.folder / name for name in self.runs)
        write_report(
            call.folder / REPORT,
            read_capture(call.folder / CAPTURE),
            run,
            metrics_of(call.folder),
            {need.task.name: need.seconds or 0.0 for need in call.needs},
            call.folder / PICTURE,
            paper=next(iter(others), None),
        )


Stage = Synthesis | Training | Evaluation | Page | Extension | Blend | Report


def run(call: Call) -> dict[str, Any]:
    """Raises what the stage raises."""
    stage: Stage = call.task.settings
    stage.make(call)
    return {}


KIND = Kind(run, version=__version__)

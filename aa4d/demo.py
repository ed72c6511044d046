"""`aa4d demo`: a scene file becomes a scene you can scrub in Blender. Each stage runs only when its inputs changed."""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from aa4d import __version__
from aa4d.blender import run_forwarding_interrupts, run_in_blender, script
from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.export import export
from aa4d.export.clip import Clip
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.filming.camera_path import path_of_frames
from aa4d.identity import digest_of, digest_of_file
from aa4d.methods.model_file import copy_model, load_model
from aa4d.methods.settings import RunSettings
from aa4d.reports.demo_report import write_report
from aa4d.scene_files import files_named_in
from aa4d.training.trainer import Progress, train

MakeTrainingProgress = Callable[[], AbstractContextManager[Progress]]
MakeStepProgress = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]


@dataclass(frozen=True)
class Stage:
    """A step that makes artefacts: files, and folders that are captures.

    It is done when its outputs are those that it made, from the inputs and settings that it has now.
    """

    name: str
    description: str
    inputs: tuple[Path, ...]
    outputs: tuple[Path, ...]
    run: Callable[[], None]
    settings: Any = None  # anything that JSON can hold

    def inputs_digest(self) -> str:
        return digest_of([__version__, self.settings, [digest_of_artefact(path) for path in self.inputs]])

    def outputs_digest(self) -> str | None:
        """None where one of them is not there."""
        try:
            return digest_of([digest_of_artefact(path) for path in self.outputs])
        except (InputError, OSError):
            return None

    def is_done(self, record: Record) -> bool:
        done = record.done.get(self.name, {})
        there = self.outputs_digest()
        return there is not None and (done.get("inputs"), done.get("outputs")) == (self.inputs_digest(), there)


def digest_of_artefact(path: Path) -> str:
    """The identity of a capture where `path` is a folder, of its bytes where it is a file."""
    return read_capture(path).identity.digest() if path.is_dir() else digest_of_file(path)


def run_demo(
    scene: Path,
    out: Path,
    config: RunSettings,
    console: Console,
    training_progress: MakeTrainingProgress,
    step_progress: MakeStepProgress,
) -> None:
    """Raises as its stages do; the same command continues at the stage that was stopped."""
    if not scene.is_file():
        raise InputError(f"{scene}: no such scene file; scenes/ holds some")
    make_folder(out)
    record = Record(out / "seconds.json")
    for stage in stages(scene, out, config, record, training_progress, step_progress, console):
        if stage.is_done(record):
            seconds = record.seconds[stage.name]
            console.print(f"[bold]{stage.name}[/bold]: done before ({seconds:.0f} s)", highlight=False, markup=True)
            continue
        console.print(f"[bold]{stage.name}[/bold]: {escape(stage.description)}", highlight=False, markup=True)
        with record.running(stage):
            stage.run()
    metrics = read_json_object(out / "metrics.json", "the metrics of an evaluation")
    summary = summarise(metrics, record.seconds)
    if config.motion is not None:
        of_paper = read_json_object(out / "paper" / "metrics.json", "the metrics of an evaluation")
        summary["paper"] = {key: of_paper[key] for key in ("psnr", "psnr_dynamic", "ssim", "fps")}
    if not (out / "summary.json").exists() or read_json_object(out / "summary.json", "the summary") != summary:
        write_json(out / "summary.json", summary)
    console.print(
        f"\nreport:   {out / 'report.html'}\nbrowser:  {out / 'page' / 'scene.html'}\n"
        f"Blender:  {out / 'flyover.blend'}\nmodel:    {out / 'model.safetensors'}",
        highlight=False,
    )


def stages(
    scene: Path,
    out: Path,
    config: RunSettings,
    record: Record,
    training_progress: MakeTrainingProgress,
    step_progress: MakeStepProgress,
    console: Console,
) -> list[Stage]:
    capture, run, paper = out / "capture", out / "run", out / "paper"
    model, metrics = out / "model.safetensors", out / "metrics.json"
    page = out / "page" / "scene.html"
    extension, blend, picture = out / "adaanchor4d.zip", out / "flyover.blend", out / "flyover.png"
    addon = (*sorted(script("addon").rglob("*.py")), script("blender_manifest.toml"))

    def synthesise() -> None:
        check(run_in_blender("synth/render_flyover.py", str(scene), "--out", str(capture)))

    def fit() -> None:
        with training_progress() as progress:
            copy_model(train(read_capture(capture), run, config, progress, say=console.print), model)

    def fit_paper() -> None:
        with training_progress() as progress:
            train(read_capture(capture), paper, replace(config, motion=None), progress, say=console.print)

    def score() -> None:
        for folder in (run, paper) if compares else (run,):
            with step_progress("held-out frames") as progress:
                evaluate(folder, capture, progress)
        write_json(metrics, read_json_object(run / "metrics.json", "the metrics of an evaluation"))

    def play() -> None:
        loaded = load_model(model)
        if page.parent.exists():  # of another model: an export is never written over
            shutil.rmtree(page.parent)
        with step_progress("views") as progress:
            said = export(Clip(loaded, path_of_frames(loaded, "all"), None), "html", page.parent, progress)
        console.print(said, highlight=False)

    def package() -> None:
        check(run_forwarding_interrupts([sys.executable, str(script("addon/build_extension.py")), str(extension)]))

    def show() -> None:
        # The local Gaussians make the better picture; in the file they lie beside the anchors, hidden in the viewport.
        arguments = (
            str(model),
            "--extension",
            str(extension),
            "--out",
            str(blend),
            "--gaussians",
            "--render",
            str(picture),
        )
        check(run_in_blender("addon/make_flyover_blend.py", *arguments))

    def report() -> None:
        measured = json.loads(metrics.read_text(encoding="utf-8"))
        write_report(
            out / "report.html",
            read_capture(capture),
            run,
            measured,
            record.seconds,
            picture,
            paper=paper if compares else None,
        )

    compares = config.motion is not None
    paper_model, settings = paper / "model.safetensors", asdict(config)
    comparison = Stage("paper", "the paper's model, for comparison", (capture,), (paper_model,), fit_paper, settings)
    models = (model, paper_model) if compares else (model,)
    rendered = (scene, *files_named_in(scene), *sorted(script("synth").rglob("*.py")))
    return [
        Stage("synthesis", f"Blender renders {scene}", rendered, (capture,), synthesise),
        Stage("training", "coarse, then fine stage", (capture,), (model,), fit, settings),
        *([comparison] if compares else []),
        Stage("evaluation", "held-out frames against truth", (*models, capture), (metrics,), score),
        Stage("page", "a page that plays the scene in a browser", (model,), (page,), play),
        Stage("extension", "packaging the Blender extension", addon, (extension,), package),
        Stage("blend", "Blender imports the model and renders a frame", (model, extension), (blend, picture), show),
        Stage("report", "pictures and tables", (capture, metrics, picture), (out / "report.html",), report),
    ]


def summarise(metrics: dict[str, Any], seconds: dict[str, float]) -> dict[str, Any]:
    keys = ("psnr", "psnr_dynamic", "psnr_dynamic_static", "ssim", "fps", "anchors", "gaussians", "neural_mib")
    return {key: metrics[key] for key in keys} | {"seconds": {name: round(s, 1) for name, s in seconds.items()}}


def check(code: int) -> None:
    """A child that refused its input or was interrupted has said so itself: its exit code becomes ours."""
    if code in (2, 130):
        sys.exit(code)
    if code != 0:
        raise InputError(f"that stage failed with exit code {code}; see its output above")


class Record:
    """Which inputs every stage was made from and how long it took, kept in a file.

    Seconds of a stage that was stopped and continued add up.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.done: dict[str, dict[str, Any]] = {}
        self._stopped: dict[str, float] = {}
        if path.exists():
            # A damaged record costs nothing but the seconds: the stages themselves know what they have finished.
            with suppress(ValueError, KeyError, TypeError):
                kept = json.loads(path.read_text(encoding="utf-8"))
                self.done, self._stopped = dict(kept["done"]), dict(kept["stopped"])

    @property
    def seconds(self) -> dict[str, float]:
        return {name: entry["seconds"] for name, entry in self.done.items()}

    @contextmanager
    def running(self, stage: Stage) -> Iterator[None]:
        started = time.perf_counter()
        before = self._stopped.pop(stage.name, 0.0)
        was_done, there = self.done.pop(stage.name, None), stage.outputs_digest()
        finished = False
        try:
            yield
            finished = True
        finally:
            seconds = before + time.perf_counter() - started
            if finished:
                made = stage.outputs_digest()
                if was_done is not None and made == there:  # looked at, and left as it was
                    seconds = was_done["seconds"]
                self.done[stage.name] = {"seconds": seconds, "inputs": stage.inputs_digest(), "outputs": made}
            else:
                self._stopped[stage.name] = seconds
            write_json(self._path, {"done": self.done, "stopped": self._stopped})

"""`aa4d demo`: a scene file becomes a scene you can scrub in Blender. Each stage runs only when its inputs changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from aa4d.blender import script
from aa4d.demo_stages import (
    BLEND,
    MODEL,
    PAGE,
    PAPER,
    REPORT,
    RUN,
    Blend,
    Evaluation,
    Extension,
    Page,
    Report,
    Stage,
    Synthesis,
    Training,
    metrics_of,
)
from aa4d.errors import InputError
from aa4d.experiments.kinds.train import iterations_of
from aa4d.files import claimed, read_json_object, write_json
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.events import Tell
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task
from aa4d.identity import digest_of, digest_of_file
from aa4d.methods.settings import RunSettings
from aa4d.scene_files import scene_digest

SUMMARY = "summary.json"


def run_demo(scene: Path, out: Path, config: RunSettings, console: Console, tell: Tell) -> None:
    """The same command continues at the stage that was stopped.

    Args:
        tell: hears what happens to the stages.

    Raises:
        InputError: a stage was refused, or another process works in `out`.
        Interrupted: Ctrl-C; what was running is saved.
    """
    tasks = stages(scene, config)
    with claimed(out, "making a demo"):
        outcome = run_graph(tasks, Store(out), engine_of("inline", Means()), tell)
        for failed in outcome.failures.values():
            raise InputError(failed.sentence)
        seconds = {task.name: outcome.kept[task.digest].seconds or 0.0 for task in tasks}
        summary = summarise(metrics_of(out), seconds)
        if config.motion is not None:
            of_paper = metrics_of(out / PAPER)
            summary["paper"] = {key: of_paper[key] for key in ("psnr", "psnr_dynamic", "ssim", "fps")}
        if not (out / SUMMARY).exists() or read_json_object(out / SUMMARY, "the summary") != summary:
            write_json(out / SUMMARY, summary)
    console.print(
        f"\nreport:   {out / REPORT}\nbrowser:  {out / PAGE}\nBlender:  {out / BLEND}\nmodel:    {out / MODEL}",
        highlight=False,
    )


def stages(scene: Path, config: RunSettings) -> tuple[Task, ...]:
    """In the order in which they are done.

    Raises:
        InputError: there is no such scene file.
    """

    def stage(name: str, settings: Stage, *needs: Task) -> Task:
        units = iterations_of(config) if isinstance(settings, Training) else 1.0
        return Task("demo", name, settings, needs, units=units, alike=name, outputs=settings.outputs)

    synthesis = stage("synthesis", Synthesis(digest_of([scene_digest(scene), sources("synth")]), scene))
    training = stage("training", Training.of(config, RUN), synthesis)
    papers = () if config.motion is None else (Training.of(replace(config, motion=None), PAPER),)
    trained = (training, *(stage("paper", paper, synthesis) for paper in papers))
    runs = (RUN, *(paper.run for paper in papers))
    evaluation = stage("evaluation", Evaluation(runs), *trained, synthesis)
    page = stage("page", Page(), training)
    extension = stage("extension", Extension(sources("addon", "blender_manifest.toml")))
    blend = stage("blend", Blend(), training, extension)
    before = (synthesis, *trained, evaluation, page, extension, blend)
    return (*before, stage("report", Report(runs), *before))


def sources(*names: str) -> str:
    """Digest of files, and of Python files in folders, of the repository."""
    paths = (script(name) for name in names)
    files = (file for path in paths for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path]))
    return digest_of([digest_of_file(file) for file in files])


def summarise(metrics: dict[str, Any], seconds: Mapping[str, float]) -> dict[str, Any]:
    keys = ("psnr", "psnr_dynamic", "psnr_dynamic_static", "ssim", "fps", "anchors", "gaussians", "neural_mib")
    return {key: metrics[key] for key in keys} | {"seconds": {name: round(s, 1) for name, s in seconds.items()}}

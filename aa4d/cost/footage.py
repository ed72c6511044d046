"""Panels of captures made from frames whose cameras are known: `aa4d capture` with one setting changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

from aa4d.capture.reader import read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings, Reconstruction
from aa4d.cost.inputs import no_capture, source_of
from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.graph.call import Call

PRESET = "fast"  # of `aa4d capture` where none is named
SECONDS = {"quick": 20.0, "full": 60.0}


def measure(call: Call) -> dict[str, Any]:
    """How far the cameras are off, and the seconds of all steps. Raises what `make_capture` raises."""
    import shutil

    from aa4d.capture.make import make_capture
    from aa4d.experiments.capture_accuracy import Clock, camera_error
    from aa4d.training.spent import Spent

    settings = call.task.settings
    source = settings.paths["capture"] if settings.paths else call.needs[0].folder
    truth = read_capture(source)
    how = dict(settings.given["reconstruction"])
    how["longest_px"] = max(64, round(settings.given["share"] * max(truth.camera.width, truth.camera.height)))
    size_px = max(truth.camera.width, truth.camera.height)
    asked = CaptureSettings(PRESET, Reconstruction(**how), size_px=size_px, threads=1)
    clock, start = Clock(), Spent.clocks()
    out = call.folder / "capture"
    made = make_capture(source / "frames", out, asked, None, clock.watch)
    clock.stop()
    spent = Spent.clocks().since(start)
    error = camera_error(made, truth)
    shutil.rmtree(out)  # what is wanted is known
    return {
        "processor_s": spent.processor_seconds,
        "wall_s": spent.seconds,
        "registered": made.frames / made.used,
        "points": made.points,
        **error,
        "steps": clock.seconds,
    }


def points(label: str, is_default: bool, result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            label,
            result["processor_s"],
            result["wall_s"],
            1e3 * result["trajectory_share"],
            is_default,
            more={
                "rotation, degrees": result["rotation_deg"],
                "frames placed": f"{100 * result['registered']:.0f} %",
                "points": result["points"],
            },
        )
    ]


def measurements(
    variants: Mapping[str, tuple[float, Reconstruction]], default: str, setup: Setup
) -> tuple[Measurement, ...]:
    source = source_of(setup)
    paths = {} if source.path is None else {"capture": source.path}
    found = []
    for label, (share, reconstruction) in variants.items():
        how = {key: value for key, value in asdict(reconstruction).items() if key != "longest_px"}
        given = {"capture": source.identity, "share": share, "reconstruction": how}
        seconds = SECONDS[setup.size.name]
        task = cost_task(__name__, f"footage, {label}", given, source.needs, seconds=seconds, paths=paths)
        found.append(Measurement(task, partial(points, label, label == default)))
    return tuple(found)


def missing(setup: Setup) -> str | None:
    if setup.capture is not None and read_capture(setup.capture).tracks is None:
        return "it needs true cameras, which a capture made by `aa4d synth` has"
    return no_capture(setup)


def footage_panel(title: str, varied: str, variants: Mapping[str, tuple[float, Reconstruction]], default: str) -> Panel:
    """
    Args:
        variants: by label, the share of the frames' size that features are found in, and all other settings.
    """
    return Panel(
        title=f"Footage: {title}",
        varied=varied,
        measured=f"`aa4d capture --preset {PRESET}` of the frames of a rendered capture on one thread, every step; "
        "errors of the cameras after the best similarity with the true ones.",
        per="capture",
        quality=Quality("error of camera places", "thousandths of the viewing distance", -1, is_log=True),
        measurements=partial(measurements, variants, default),
        missing=missing,
    )


USUAL = PRESETS[PRESET]

"""On how large pictures is trained."""

from __future__ import annotations

from functools import partial
from typing import Any

from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.cost.inputs import no_capture, scaled, source_of, trained
from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Setup
from aa4d.cost.training import PSNR, base
from aa4d.graph.call import Call

SHARES = (0.25, 0.5, 1.0)


def measure(call: Call) -> dict[str, Any]:
    """A model that was trained on smaller pictures, scored on those of the whole size."""
    from aa4d.methods.model_file import load_model

    run, *rendered = call.needs
    settings = call.task.settings
    loaded = load_model(run.folder / "model.safetensors")
    capture = read_capture(settings.paths["capture"] if settings.paths else rendered[0].folder)
    return {
        "psnr": held_out_psnr(loaded, capture),
        "processor_s": loaded.training_processor_seconds,
        "wall_s": loaded.training_seconds,
        "units": len(loaded.model),
    }


def held_out_psnr(loaded: Any, capture: Capture) -> float:
    """The mean over the held-out frames of `capture`, drawn in its size."""
    import statistics

    import torch

    from aa4d.evaluation.image_metrics import psnr
    from aa4d.methods.rendering import render

    c, found = capture.camera, []
    for index in capture.of_split("test"):
        frame = capture.frames[index]
        camera = loaded.frame.camera(frame.viewmat, c.K, c.width, c.height)
        with torch.no_grad():
            color = render(loaded.model, frame.t, camera, torch.tensor(loaded.background)).rendering.color
        found.append(psnr(color.clamp(0, 1), torch.from_numpy(read_image(capture, frame)).float() / 255))
    return statistics.fmean(found)


def points(share: float, result: dict[str, Any]) -> list[Point]:
    cost = result["processor_s"], result["wall_s"]
    return [Point(f"{share:g} times", *cost, result["psnr"], share == 1, more={"units": result["units"]})]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    whole = source_of(setup)
    paths = {} if whole.path is None else {"capture": whole.path}
    found = []
    for share in SHARES:
        run = trained(setup, f"at {share:g} times the size", base(setup), scaled(setup, share))
        given = {"capture": whole.identity}
        task = cost_task(__name__, f"image scale {share:g}", given, (run, *whole.needs), seconds=3, paths=paths)
        found.append(Measurement(task, partial(points, share)))
    return tuple(found)


PANEL = Panel(
    title="Training: image scale",
    varied="The size of the training frames, in times that of the capture; by default they are as they are.",
    measured="The paper's model by the preset `quick`, with as many iterations as the top of the page says; PSNR is "
    "that of held-out frames in their whole size.",
    per="training",
    quality=PSNR,
    measurements=measurements,
    missing=no_capture,
)

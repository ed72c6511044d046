"""The demo's report: one HTML file that holds its pictures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from aa4d import __version__
from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.errors import InputError
from aa4d.evaluation.plots import psnr_figure
from aa4d.files import read_json_object, write_text
from aa4d.identity import Identity, digest_of, identity_of
from aa4d.reports.page import environment
from aa4d.reports.pictures import ERROR_GAIN, error_picture, png_uri

PICTURED_FRAMES = 3


def write_report(
    path: Path,
    capture: Capture,
    run: Path,
    metrics: dict[str, Any],
    seconds: dict[str, float],
    blender_picture: Path,
    *,
    paper: Path | None = None,
) -> None:
    """Write `path` from what `aa4d eval` left in a run's folder (eval/NAME.png and eval/NAME_static.png).

    Args:
        paper: the evaluated run of the paper's model to compare with; None: with the run's own static stage.

    Raises:
        InputError: a render is missing, or the metrics are those of an older aa4d.
    """
    if "training_frames" not in metrics:
        raise InputError(f"{path.parent}: metrics.json was written by an older aa4d; delete it and run again")
    of_paper = None if paper is None else read_json_object(paper / "metrics.json", "the metrics of an evaluation")
    sources = {"evaluation": metrics} | ({} if of_paper is None else {"paper": of_paper})
    made_from = {name: _evaluation_of(capture, path, values).digest() for name, values in sources.items()}
    made_from["capture"] = capture.identity.digest()
    identity = Identity("report", digest_of({"version": __version__}), made_from)
    html = (
        environment()
        .get_template("demo_report.html.jinja")
        .render(
            name=capture.name,
            frames=[_row(capture, run, paper, score) for score in spread(metrics["frames"], PICTURED_FRAMES)],
            metrics=metrics,
            paper=of_paper,
            identity=identity.as_text(),
            seconds=seconds,
            total=sum(seconds.values()),
            plot=_svg(psnr_figure(metrics)),
            blender=png_uri(np.asarray(Image.open(blender_picture).convert("RGB"))),
            train_frames=len(capture.of_split("train")),
            gain=ERROR_GAIN,
        )
    )
    write_text(path, html)


def _evaluation_of(capture: Capture, path: Path, metrics: dict[str, Any]) -> Identity:
    identity = identity_of(metrics.get("identity"))
    if identity is None or identity.made_from.get("capture") != capture.identity.digest():
        raise InputError(f"{path}: the metrics are not of {capture.folder} as it is now; run `aa4d eval` again")
    return identity


def spread(frames: list[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """`count` of the frames that have moving pixels (of all, where none has), evenly over time, ends left out."""
    moving = [f for f in frames if f["moving_share"]] or frames
    positions = np.linspace(0, len(moving) - 1, count + 2)[1:-1].round().astype(int)
    return [moving[i] for i in sorted(set(positions.tolist()))]


def _row(capture: Capture, run: Path, paper: Path | None, score: dict[str, Any]) -> dict[str, Any]:
    index = next(i for i, frame in enumerate(capture.frames) if frame.name == score["frame"])
    truth = read_image(capture, capture.frames[index])
    try:
        render = np.asarray(Image.open(run / f"eval/{score['frame']}.png"))
        of_paper = None if paper is None else np.asarray(Image.open(paper / f"eval/{score['frame']}.png"))
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read; delete metrics.json and run again") from None
    static_path = run / f"eval/{score['frame']}_static.png"
    mask = moving_mask(capture, index)
    return {
        "score": score,
        "truth": png_uri(truth),
        "render": png_uri(render),
        "paper": None if of_paper is None else png_uri(of_paper),
        "static": png_uri(np.asarray(Image.open(static_path))) if static_path.exists() else None,
        "error": png_uri(error_picture(truth, render)),
        "moving": None if mask is None else png_uri(np.where(mask[..., None], truth, truth // 4)),
    }


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    return buffer.getvalue()[buffer.getvalue().index("<svg") :]

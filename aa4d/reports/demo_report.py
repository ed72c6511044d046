"""The demo's report: one HTML file that holds its pictures."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from aa4d import __version__
from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.errors import InputError
from aa4d.evaluation.plots import psnr_figure
from aa4d.files import read_json_object, write_text
from aa4d.identity import Identity, digest_of, identity_of

PICTURED_FRAMES = 3
ERROR_GAIN = 4  # an error of a quarter of the range is the top of the colour scale


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
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("demo_report.html.jinja").render(
        name=capture.name,
        frames=[_row(capture, run, paper, score) for score in spread(metrics["frames"], PICTURED_FRAMES)],
        metrics=metrics,
        paper=of_paper,
        identity=identity.as_text(),
        seconds=seconds,
        total=sum(seconds.values()),
        plot=_svg(psnr_figure(metrics)),
        blender=_data_uri(np.asarray(Image.open(blender_picture).convert("RGB"))),
        train_frames=len(capture.of_split("train")),
        gain=ERROR_GAIN,
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
        "truth": _data_uri(truth),
        "render": _data_uri(render),
        "paper": None if of_paper is None else _data_uri(of_paper),
        "static": _data_uri(np.asarray(Image.open(static_path))) if static_path.exists() else None,
        "error": _data_uri(_error_picture(truth, render)),
        "moving": None if mask is None else _data_uri(np.where(mask[..., None], truth, truth // 4)),
    }


def _error_picture(truth: NDArray[np.uint8], render: NDArray[np.uint8]) -> NDArray[np.uint8]:
    error = np.abs(truth.astype(np.float32) - render).mean(axis=2) / 255
    colors = matplotlib.colormaps["inferno"](np.clip(error * ERROR_GAIN, 0, 1))
    return (colors[..., :3] * 255).round().astype(np.uint8)


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    return buffer.getvalue()[buffer.getvalue().index("<svg") :]


def _data_uri(image: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")

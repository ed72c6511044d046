"""`aa4d inspect`: one page that holds its pictures, and the pictures beside it."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from aa4d import __version__
from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import capture_of
from aa4d.files import whole_file, write_text
from aa4d.filming.camera_path import View
from aa4d.filming.layers import LAYERS, Layer, colored, draw, scale_of
from aa4d.identity import Identity, digest_of
from aa4d.inspection.history import history_figure, read_history
from aa4d.inspection.motion_groups import groups_by_motion, groups_by_truth
from aa4d.inspection.trajectories import map_figure, over_frame_figure, trajectories
from aa4d.inspection.warp import stretch, warp_figure
from aa4d.inspection.weights import planes_figure, summary, weights_figure, weights_over_time
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.output_folder import claim_folder

PAINTED_FRAMES = 2
INDEX = "inspect.json"


class Pictures:
    """PNG files in a folder, and the same as data URIs for the page."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def figure(self, name: str, figure: Figure) -> str:
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=130)
        return self._keep(name, buffer.getvalue())

    def image(self, name: str, image: NDArray[np.uint8]) -> str:
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, format="PNG")
        return self._keep(name, buffer.getvalue())

    def _keep(self, name: str, content: bytes) -> str:
        with whole_file(self._folder / f"{name}.png") as temporary:
            temporary.write_bytes(content)
        return "data:image/png;base64," + base64.b64encode(content).decode("ascii")


def inspect(
    run: Path, capture_folder: Path | None, out: Path, progress: Callable[[int, int], None]
) -> tuple[Path, str | None]:
    """Write `out`/index.html and its pictures.

    Args:
        capture_folder: where the capture lies; None to follow the model file, and to do without if it is not there.

    Returns:
        The path of the page, and what it does without and why.

    Raises:
        InputError: no model, a model of the coarse stage, another capture, or `out` holds something else.
    """
    steps = 6
    loaded = load_model(run / "model.safetensors")
    if loaded.is_static:
        raise InputError(f"{loaded.path}: is of the coarse stage, in which nothing moves yet; train it further")
    coarse = load_model(run / "coarse.safetensors") if (run / "coarse.safetensors").exists() else None
    history = read_history(run / "history.csv")
    capture = note = None
    if capture_folder is not None or (loaded.capture_folder is not None and loaded.capture_folder.is_dir()):
        capture = capture_of(loaded, capture_folder)
    else:
        note = (
            f"{loaded.capture_folder}: the capture is not there; the page does without its frames, and motion is the "
            "model's own (--capture says where it is)"
        )
    claim_folder(out, INDEX, {"page": "aa4d inspect"}, "pages of `aa4d inspect`")
    pictures = Pictures(out)
    _remove_pictures(out, loaded)
    progress(1, steps)
    groups = (groups_by_truth(loaded, capture) if capture is not None else None) or groups_by_motion(loaded)
    weights = weights_over_time(loaded, groups)
    progress(2, steps)
    painted, scales = _paint(loaded, capture, pictures, with_weights=weights is not None)
    progress(3, steps)
    ways = _trajectories(loaded, capture, pictures)
    progress(4, steps)
    warp = warp_figure(loaded, coarse)
    made_from = {"model": loaded.identity.digest()}
    if capture is not None:
        made_from["capture"] = capture.identity.digest()
    context: dict[str, Any] = {
        "identity": Identity("report", digest_of({"version": __version__}), made_from).as_text(),
        "name": run.resolve().name,
        "anchors": len(loaded.model),
        "coarse_anchors": None if coarse is None else len(coarse.model),
        "rule": groups.rule,
        "summary": None if weights is None else summary(weights),
        "weights": None if weights is None else pictures.figure("weights_over_time", weights_figure(weights)),
        "planes": None if weights is None else pictures.figure("weights_by_plane", planes_figure(weights)),
        "painted": painted,
        "scales": scales,
        "groups": None if loaded.model.groups is None else len(loaded.model.groups),
        "trajectories": ways,
        "warp": None if warp is None else pictures.figure("warp", warp),
        "stretch": stretch(loaded),
        "history": None if history is None else pictures.figure("history", history_figure(history)),
    }
    progress(5, steps)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    page = out / "index.html"
    write_text(page, environment.get_template("page.html.jinja").render(context))
    progress(6, steps)
    return page, note


def _remove_pictures(out: Path, loaded: LoadedModel) -> None:
    """Remove pictures of an earlier page, which may have shown other frames: beside the new one they would mislead."""
    for frame in loaded.frames:
        for kind in ("frame", "render", "trajectories", *LAYERS):
            (out / f"{frame.name}_{kind}.png").unlink(missing_ok=True)


def _trajectories(loaded: LoadedModel, capture: Capture | None, pictures: Pictures) -> list[tuple[str, str]]:
    """Captions and pictures: some frames with the paths over them, and the map."""
    paths = trajectories(loaded)
    shown = []
    for index in _busiest(loaded, capture):
        frame = loaded.frames[index]
        if capture is None:
            picture = draw(loaded, View(frame.name, frame.t, frame.viewmat), loaded.camera, ["color"]).color
        else:
            picture = read_image(capture, capture.frames[index])
        label = f"over the {'render' if capture is None else f'frame {frame.name}'}, t = {frame.t:.2f}"
        figure = over_frame_figure(loaded, picture, index, paths, label)
        shown.append((label, pictures.figure(f"{frame.name}_trajectories", figure)))
    shown.append(("from above", pictures.figure("trajectories", map_figure(loaded, paths))))
    return shown


def _paint(
    loaded: LoadedModel, capture: Capture | None, pictures: Pictures, *, with_weights: bool
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Some frames with what the anchors are painted with, and the colour scales, common to these frames."""
    names = ["activity", "motion"] if with_weights else ["motion"]
    indices = _busiest(loaded, capture)
    views = [View(loaded.frames[i].name, loaded.frames[i].t, loaded.frames[i].viewmat) for i in indices]
    drawn = [draw(loaded, view, loaded.camera, names) for view in views]
    scales = {name: scale_of(LAYERS[name], [d.values[name] for d in drawn]) for name in names}
    rows = []
    for index, view, picture in zip(indices, views, drawn, strict=True):
        row: dict[str, Any] = {"frame": view.name, "t": view.t, "frame_picture": None}
        if capture is not None:
            row["frame_picture"] = pictures.image(f"{view.name}_frame", read_image(capture, capture.frames[index]))
        row["render"] = pictures.image(f"{view.name}_render", picture.color)
        row["layers"] = [
            (LAYERS[n].meaning, pictures.image(f"{view.name}_{n}", colored(LAYERS[n], picture.values[n], scales[n])))
            for n in names
        ]
        rows.append(row)
    return rows, [_described(LAYERS[n], scales[n], pictures, n) for n in names]


def _described(layer: Layer, scale: tuple[float, float], pictures: Pictures, name: str) -> dict[str, Any]:
    ramp = np.linspace(*scale, 256, dtype=np.float32)[None].repeat(12, axis=0)
    return {
        "meaning": layer.meaning,
        "unit": layer.unit,
        "lower": scale[0],
        "upper": scale[1],
        "ramp": pictures.image(f"{name}_scale", colored(layer, ramp, scale)),
    }


def _busiest(loaded: LoadedModel, capture: Capture | None) -> list[int]:
    """From each of as many equal parts of the clip the frame with the most moving pixels, or the middle one."""
    parts = np.array_split(np.arange(len(loaded.frames)), min(PAINTED_FRAMES, len(loaded.frames)))
    chosen = []
    for part in parts:
        moving = [0.0] * len(part)
        if capture is not None:
            masks = [moving_mask(capture, int(i)) for i in part]
            moving = [0.0 if mask is None else float(mask.mean()) for mask in masks]
        best = int(np.argmax(moving)) if any(moving) else len(part) // 2
        chosen.append(int(part[best]))
    return chosen

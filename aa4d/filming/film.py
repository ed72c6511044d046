"""A camera path rendered into a folder: a picture for each view and layer, a video for each layer. Resumes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from aa4d.capture.schema import number_of
from aa4d.errors import InputError
from aa4d.files import whole_file, write_json
from aa4d.filming.camera_path import CameraPath
from aa4d.filming.layers import LAYERS, colored, draw, scale_of
from aa4d.filming.video import write_video
from aa4d.methods.model_file import LoadedModel
from aa4d.output_folder import claim_folder, index_of

INDEX = "render.json"
VERSION = 1
SCALE_VIEWS = 5  # views, evenly along the path, that a colour scale is measured on

Scales = dict[str, tuple[float, float]]


def film(
    loaded: LoadedModel,
    path: CameraPath,
    layers: list[str],
    out: Path,
    *,
    video: bool,
    progress: Callable[[int, int], None],
) -> Scales:
    """Write `out`/LAYER/NAME.png for each view, `out`/LAYER.mp4, `out`/LAYER_scale.png and `out`/render.json.

    Pictures that are there already are kept: a film that was stopped continues, and another layer can be added.

    Returns:
        The colour scale of each layer that has one.

    Raises:
        InputError: `out` holds something else.
    """
    index = claim_folder(out, INDEX, _settings(loaded, path), "a render")
    scales = _scales(loaded, path, layers, index, out)
    for name in scales:
        _write_legend(out / f"{name}_scale.png", name, scales[name])
    for name in layers:
        (out / name).mkdir(exist_ok=True)
    for done, view in enumerate(path.views):
        missing = [name for name in layers if not (out / name / f"{view.name}.png").exists()]
        if missing:
            drawn = draw(loaded, view, path.camera, missing)
            for name in missing:
                _write_png(out / name / f"{view.name}.png", drawn.picture(name, scales.get(name)))
        progress(done + 1, len(path.views))
    if video and len(path.views) > 1:
        for name in layers:
            if not (out / f"{name}.mp4").exists():
                pictures = (_read_png(out / name / f"{view.name}.png") for view in path.views)
                write_video(out / f"{name}.mp4", pictures, path.fps, None if path.is_even else path.at)
    return {name: scales[name] for name in layers if name in scales}


def _settings(loaded: LoadedModel, path: CameraPath) -> dict[str, Any]:
    """Everything that a picture depends on."""
    return index_of("render", loaded, {"format": "aa4d-render", "version": VERSION} | path.as_json())


def _scales(loaded: LoadedModel, path: CameraPath, layers: list[str], index: dict[str, Any], out: Path) -> Scales:
    """Bounds that the index has, so that a film keeps its scale when it continues, and new ones, which it then has."""
    try:
        kept = dict(index.get("scales", {}))
        scales = {
            name: (number_of(scale, "lower", out / INDEX), number_of(scale, "upper", out / INDEX))
            for name, scale in kept.items()
        }
    except (AttributeError, TypeError, ValueError):
        raise InputError(f"{out / INDEX}: is damaged; delete that folder and render again") from None
    new = [name for name in layers if name in LAYERS and name not in scales]
    if new:
        chosen = np.linspace(0, len(path.views) - 1, min(SCALE_VIEWS, len(path.views))).round().astype(int)
        drawn = [draw(loaded, path.views[i], path.camera, new) for i in chosen]
        for name in new:
            scales[name] = scale_of(LAYERS[name], [d.values[name] for d in drawn])
            layer = LAYERS[name]
            kept[name] = {
                "meaning": layer.meaning,
                "unit": layer.unit,
                "lower": scales[name][0],
                "upper": scales[name][1],
                "colormap": f"matplotlib {layer.colormap}, black where nothing is",
            }
        write_json(out / INDEX, index | {"scales": kept})
    return scales


def _write_legend(path: Path, name: str, scale: tuple[float, float]) -> None:
    if path.exists():
        return
    layer = LAYERS[name]
    figure = Figure(figsize=(5, 0.9), layout="constrained")
    axes = figure.add_subplot()
    ramp = np.linspace(*scale, 512, dtype=np.float32)[None]
    axes.imshow(colored(layer, ramp, scale), aspect="auto", extent=(*scale, 0, 1))
    axes.set(yticks=[], xlabel=layer.meaning + (f", {layer.unit}" if layer.unit else ""))
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def _write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    with whole_file(path) as temporary:
        Image.fromarray(picture).save(temporary, format="PNG")


def _read_png(path: Path) -> NDArray[np.uint8]:
    try:
        with Image.open(path) as image:
            return np.array(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); delete it and run again") from None

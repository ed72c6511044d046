"""One HTML file that plays the scene in a browser, offline: Gaussians at key times, and the player in `player/`.

The Gaussians are rounded to even steps, each key is told by its difference from the one before, and everything is
deflated: most differences are zero. Names of a run lie in that block too, as JSON in base64, where nothing can be taken
for markup; the page itself runs no script but its own, which it names by digest.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from aa4d import __version__
from aa4d.export.clip import FAINTEST, Clip
from aa4d.export.keys import decoded, drawn_ids, times_of
from aa4d.files import write_text
from aa4d.raster.constants import DILATION, FRUSTUM_MARGIN, MAX_ALPHA

NAME = "scene.html"
PLAYER = Path(__file__).parent / "player"
# One after the other: each uses what stands before it.
SCRIPTS = ("scene.js", "pose.js", "gpu.js", "cpu.js", "controls.js", "main.js")
WORKER_SCRIPTS = ("scene.js", "splats.js", "worker.js")
PLACE_STEP_PX = 0.05  # in the clip's pixels, at the distance of the scene
LARGEST_LEVEL = 2**29  # so that a change fits into 31 bits
Levels = NDArray[np.int32]


@dataclass(frozen=True)
class Attribute:
    """How an attribute is rounded: to multiples of `step`, at most `levels` to either side of zero."""

    channels: int
    step: float
    levels: int


def attributes_of(clip: Clip) -> dict[str, Attribute]:
    """The player packs all but the position into bytes, and a logarithm of a scale into ten bits."""
    pixel_m = clip.loaded.frame.unit_m / max(clip.path.camera.K[0, 0], clip.path.camera.K[1, 1])
    return {
        "position": Attribute(3, float(PLACE_STEP_PX * pixel_m), LARGEST_LEVEL),
        "rotation": Attribute(4, 1 / 127, 127),
        "log_scale": Attribute(3, 0.03, 511),
        "opacity": Attribute(1, 1 / 255, 255),
        "color": Attribute(3, 1 / 255, 255),
    }


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> str:
    """`out`/scene.html.

    Returns:
        What it costs: size and error, in a sentence.

    Raises:
        InputError: the views' times do not rise, or nothing would be drawn.
    """
    path, times, attributes = out / NAME, times_of(clip, "html"), attributes_of(clip)
    if path.exists():
        progress(2 * len(clip), 2 * len(clip))
        return stated(path, attributes)
    ids = drawn_ids(clip, lambda done: progress(done, 2 * len(clip)))
    keys: dict[str, list[Levels]] = {name: [] for name in attributes}
    for index, values in enumerate(decoded(clip)):
        for name, attribute in attributes.items():
            keys[name].append(rounded(values[name][ids], attribute))
        progress(len(clip) + index + 1, 2 * len(clip))
    streams, layout = b"", {}
    for name, attribute in attributes.items():
        levels = np.stack(keys.pop(name))
        packed, widths = packed_keys(levels)
        streams += packed
        layout[name] = {"channels": attribute.channels, "step": attribute.step, **widths}
    header = _header(clip, times, len(ids), layout)
    write_text(path, page_of(header, streams))
    return stated(path, attributes)


def rounded(values: NDArray[np.float32], attribute: Attribute) -> Levels:
    """Levels [N, D]."""
    levels = np.round(values.astype(np.float64) / attribute.step)
    return levels.clip(-attribute.levels, attribute.levels).astype(np.int32)


def packed_keys(levels: Levels) -> tuple[bytes, dict[str, int]]:
    """Levels [T, N, D] as bytes, channel by channel: the first key, then what each key adds to the one before.

    Small numbers of either sign become small ones, 0 -1 1 -2 2 as 0 1 2 3 4, and bytes lie in planes: all lowest ones,
    all next ones. Deflate finds the zeros.

    Returns:
        The bytes, and of how many bytes the numbers of the first key and of the changes are.
    """
    first, changes = _unsigned(levels[0]), _unsigned(np.diff(levels, axis=0))
    widths = {"first_bytes": _width(first), "change_bytes": _width(changes)}
    parts = []
    for channel in range(levels.shape[2]):
        parts += list(_planes(first[:, channel], widths["first_bytes"]))
        parts += list(_planes(changes[:, :, channel], widths["change_bytes"]))
    return b"".join(parts), widths


def _unsigned(levels: Levels) -> NDArray[np.uint32]:
    wide = levels.astype(np.int64)
    return np.where(wide < 0, -2 * wide - 1, 2 * wide).astype(np.uint32)


def _width(numbers: NDArray[np.uint32]) -> int:
    largest = int(numbers.max(initial=0))
    return max(1, (largest.bit_length() + 7) // 8)


def _planes(numbers: NDArray[np.uint32], width: int) -> Iterable[bytes]:
    return (((numbers >> 8 * byte) & 255).astype(np.uint8).tobytes() for byte in range(width))


def _header(clip: Clip, times: list[float], count: int, layout: dict[str, Any]) -> dict[str, Any]:
    loaded = clip.loaded
    folder = loaded.capture_folder
    return {
        "title": "A scene in time" if folder is None else folder.name,
        "generator": f"aa4d {__version__}",
        "method": loaded.method,
        "count": count,
        "t": times,
        "seconds": clip.path.at.tolist(),
        "fps": clip.path.fps,
        "camera": clip.path.camera.as_json(),
        "views": [view.viewmat.tolist() for view in clip.path.views],
        "background": list(loaded.background),
        "near": loaded.frame.camera(np.eye(4), np.eye(3), 1, 1).near * loaded.frame.unit_m,
        "distance": loaded.frame.unit_m,
        "constants": {
            "dilation": DILATION,
            "margin": FRUSTUM_MARGIN,
            "max_alpha": MAX_ALPHA,
            "faintest": FAINTEST,
        },
        "attributes": layout,
        "origin": None if clip.origin is None else dict(clip.origin),
        **({} if clip.identity is None else {"identity": clip.identity.as_json()}),
    }


def page_of(header: dict[str, Any], streams: bytes) -> str:
    """The page, whole: markup, style, shaders, scripts and the scene."""
    text = json.dumps(header, allow_nan=False).encode()
    block = zlib.compress(len(text).to_bytes(4, "little") + text + streams, 6)
    parts = {name: (PLAYER / name).read_text(encoding="utf-8") for name in ("style.css", "splat.vert", "splat.frag")}
    script, worker = (_joined(names) for names in (SCRIPTS, WORKER_SCRIPTS))
    environment = Environment(loader=FileSystemLoader(PLAYER), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("page.html.jinja").render(
        title=header["title"],
        generator=header["generator"],
        identity=json.dumps(header.get("identity")),
        style=parts["style.css"],
        vertex=parts["splat.vert"],
        fragment=parts["splat.frag"],
        worker=worker,
        script=script,
        style_digest=_digest(parts["style.css"]),
        script_digest=_digest(script),
        scene=base64.b64encode(block).decode("ascii"),
    )


def _joined(names: Iterable[str]) -> str:
    return '"use strict";\n' + "\n".join((PLAYER / name).read_text(encoding="utf-8") for name in names)


def _digest(text: str) -> str:
    """As a content security policy names what may run."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


def stated(path: Path, attributes: dict[str, Attribute]) -> str:
    half = {name: attribute.step / 2 for name, attribute in attributes.items()}
    return (
        f"{path.stat().st_size / 1e6:.1f} MB; places are rounded by at most {1000 * half['position']:.2g} mm, "
        f"rotations by {half['rotation']:.2g}, sizes by {100 * half['log_scale']:.2g} %, opacities and colors by "
        f"{half['color']:.2g} of 1"
    )

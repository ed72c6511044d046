"""The capture's report: one HTML file that holds its pictures and its data."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aa4d import __version__
from aa4d.capture.clip import Clip
from aa4d.capture.mapping import Cameras
from aa4d.capture.matching import Matches
from aa4d.capture.placement import Placement
from aa4d.capture.reader import read_capture
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.selfcheck import SelfCheck
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.writing import Cloud, Shot
from aa4d.files import write_text
from aa4d.identity import Identity, digest_of
from aa4d.reports.page import environment

SHOWN_POINTS = 20_000
PICTURED_FRAMES = 4
PICTURE_PX = 480


def write_report(
    made: CaptureSummary,
    clip: Clip,
    cameras: Cameras,
    matches: Matches | None,
    checked: SelfCheck,
    placement: Placement,
) -> None:
    shots, pinhole = placement.shots, placement.pinhole
    capture = read_capture(made.folder).identity
    centers = np.array([-s.viewmat[:3, :3].T @ s.viewmat[:3, 3] for s in shots])
    right, down, ahead = (np.array([s.viewmat[axis, :3] for s in shots]) for axis in range(3))
    html = (
        environment(Path(__file__).parent)
        .get_template("report.html.jinja")
        .render(
            identity=Identity("report", digest_of({"version": __version__}), {"capture": capture.digest()}).as_text(),
            made=made,
            clip=clip,
            cameras=cameras,
            geometry={} if matches is None else matches.geometry,
            checked=checked,
            pinhole=pinhole,
            total=sum(made.seconds.values()),
            share=made.frames / made.used,
            frame_errors=_svg_bars([checked.frame_px.get(s.name, 0.0) for s in shots]),
            histogram=_svg_bars(checked.histogram),
            pictures=[_picture(made.folder, shots[i]) for i in spread(len(shots))],
            view=_view(placement.cloud, centers, right, down, ahead, pinhole),
        )
    )
    write_text(made.report, html)


def spread(count: int) -> list[int]:
    return sorted(set(np.linspace(0, count - 1, PICTURED_FRAMES).round().astype(int).tolist()))


def _view(
    cloud: Cloud,
    centers: NDArray[np.float64],
    right: NDArray[np.float64],
    down: NDArray[np.float64],
    ahead: NDArray[np.float64],
    pinhole: PinholeCamera,
) -> dict[str, Any]:
    """Contents of the page's 3D view, centered and at unit size: points, colors, camera frusta."""
    chosen = np.random.default_rng(0).permutation(len(cloud.positions))[:SHOWN_POINTS]
    points, colors = cloud.positions[chosen], cloud.colors[chosen]
    # Nine tenths of the points and all cameras fill the view, around the middle of both.
    near = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    shown = np.concatenate([points[near <= np.percentile(near, 90)], centers])
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    reach = float(np.linalg.norm(shown - middle, axis=1).max())
    depth = 0.06 * reach
    half_width = 0.5 * pinhole.width / pinhole.K[0, 0] * depth
    half_height = 0.5 * pinhole.height / pinhole.K[1, 1] * depth
    corners = [
        centers + depth * ahead + x * half_width * right + y * half_height * down
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    frusta = np.stack([centers, *corners], axis=1)
    return {
        "points": _base64(((points - middle) / reach).astype("<f4")),
        "colors": _base64(colors),
        "frusta": _base64(((frusta - middle) / reach).astype("<f4")),
    }


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def _svg_bars(values: Sequence[float]) -> str:
    """Bars as SVG, the highest filling the height."""
    top = max([*values, 1e-9])
    bars = "".join(
        f'<rect x="{i}" y="{1 - v / top:.4f}" width=".8" height="{v / top:.4f}"><title>{v:.3g}</title></rect>'
        for i, v in enumerate(values)
    )
    return f'<svg viewBox="0 0 {len(values)} 1" preserveAspectRatio="none">{bars}</svg>'


def _picture(folder: Path, shot: Shot) -> dict[str, str]:
    """A frame of the capture; what was masked as moving is tinted."""
    with Image.open(folder / "frames" / f"{shot.name}.png") as opened:
        image = opened.convert("RGB")
    mask_path = folder / "movers" / f"{shot.name}.png"
    if mask_path.is_file():
        with Image.open(mask_path) as mask:
            tint = Image.new("RGB", image.size, (255, 60, 0))
            image = Image.composite(Image.blend(image, tint, 0.5), image, mask.convert("L"))
    image.thumbnail((PICTURE_PX, PICTURE_PX))
    buffer = io.BytesIO()
    image.save(buffer, format="JPEG", quality=85)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return {"source": f"data:image/jpeg;base64,{data}", "label": shot.label}

"""The contact sheet of what `aa4d synth sheet` filmed."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from aa4d.files import read_json_object, write_bytes

ACTIVITY_COLORS = ("#3b4252", "#f2a33a", "#d9412b", "#5aa9e6", "#e8ebf0")  # by label


def plot(measured: Path, picture: Path) -> None:
    """A row for each scene: frame, depth, forward flow (hue: direction, brightness: length) and activity."""
    import numpy as np
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.image import imread
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.patches import Patch

    from aa4d.evaluation.activity import CLASSES

    found = read_json_object(measured, "the measurements of `aa4d synth sheet`")
    rows, (width, height) = found["scenes"], found["size"]
    across = 3.2  # inches of a picture
    tight = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, wspace=0, hspace=0)
    figure = Figure(figsize=(4 * across, len(rows) * across * height / width + 0.45), layout=tight)
    axes = figure.subplots(len(rows), 4, squeeze=False)
    colors = ListedColormap(ACTIVITY_COLORS)
    for row, cells in zip(rows, axes, strict=True):
        folder = measured.parent / row["scene"]
        with np.load(folder / "truth.npz", allow_pickle=False) as truth:
            depth, flow = truth["depth_z"], truth["flow_forward"]
        cells[0].imshow(imread(folder / "frame.png"))
        cells[1].imshow(np.log(depth), cmap="viridis_r")  # the sky is infinite, and stays white
        cells[2].imshow(flow_colors(flow))
        labels = np.round(255 * imread(folder / "activity.png"))
        cells[3].imshow(labels, cmap=colors, vmin=0, vmax=len(CLASSES) - 1, interpolation="nearest")
        cells[0].set_ylabel(row["scene"])
    for axis, title in zip(axes[0], ("frame", "depth", "flow to the next frame", "activity"), strict=True):
        axis.set_title(title, fontsize=10)
    for axis in axes.ravel():
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set_visible(False)
    named = zip(CLASSES, ACTIVITY_COLORS, strict=True)
    patches = [Patch(facecolor=color, edgecolor="#999999", label=name) for name, color in named]
    figure.legend(handles=patches, loc="outside lower right", ncols=len(patches), fontsize=9, frameon=False)
    buffer = BytesIO()  # Pillow writes JPEG past Python, and takes what a full disk has no room for as written
    figure.savefig(buffer, format="jpg", dpi=110)
    write_bytes(picture, buffer.getvalue())


def flow_colors(flow: Any) -> Any:
    """RGB [H, W, 3] of a flow [H, W, 2]: hue says where to, brightness how far; unknown flow is white."""
    import numpy as np
    from matplotlib.colors import hsv_to_rgb

    length = np.hypot(flow[..., 0], flow[..., 1])
    known = np.isfinite(length)
    most = max(float(np.percentile(length[known], 99)), 1e-6) if known.any() else 1.0
    hue = np.where(known, (np.arctan2(flow[..., 1], flow[..., 0]) / (2 * np.pi)) % 1.0, 0.0)
    value = np.where(known, np.clip(np.nan_to_num(length) / most, 0.0, 1.0), 1.0)
    return hsv_to_rgb(np.stack([hue, np.where(known, 0.9, 0.0), value], axis=-1))

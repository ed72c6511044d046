"""The plot of what `aa4d synth cost` measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aa4d.files import read_json_object, whole_file


def plot(measured: Path, picture: Path) -> None:
    """Four panels from the JSON that synth/cost.py wrote: quality of a frame, traffic, motion blur, effects."""
    from matplotlib.figure import Figure

    found = read_json_object(measured, "the measurements of `aa4d synth cost`")
    figure = Figure(figsize=(11, 8), layout="constrained")
    quality, traffic, blur, effects = figure.subplots(2, 2).ravel()
    for denoise, label in ((False, "raw"), (True, "denoised")):
        rows = [row for row in found["render"] if row["denoise"] == denoise and "psnr_db" in row]
        quality.plot([r["seconds"] for r in rows], [r["psnr_db"] for r in rows], "o-", label=label)
        for row in rows:
            quality.annotate(f"{row['samples']}", (row["seconds"], row["psnr_db"]), fontsize=8)
    quality.set(xscale="log", xlabel="seconds per frame", ylabel="PSNR (dB)", title="samples per pixel")
    quality.legend()
    done = [row for row in found["traffic"] if "worst_m" in row]
    traffic.plot([r["step_s"] for r in done], [max(r["worst_m"], 1e-9) for r in done], "o-", label="worst")
    traffic.plot([r["step_s"] for r in done], [max(r["mean_m"], 1e-9) for r in done], "o-", label="mean")
    traffic.set(xscale="log", yscale="log", xlabel="step (s)", ylabel="position error (m)", title="traffic simulation")
    traffic.legend()
    blur.plot([r["steps"] for r in found["motion_blur"]], [r["psnr_db"] for r in found["motion_blur"]], "o-")
    blur.set_xticks([row["steps"] for row in found["motion_blur"]])
    blur.set(xlabel="steps (motion in 2^steps pieces)", ylabel="PSNR (dB)", title="motion blur")
    _bars(effects, found["effects"])
    with whole_file(picture) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _bars(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Seconds of a frame with each effect, truth and picture stacked; a line where there is none."""
    rows = [row for row in rows if "picture" in row]
    names, pictures = [row["effect"] for row in rows], [row["picture"] for row in rows]
    axes.barh(names, pictures, label="picture")
    axes.barh(names, [row["truth"] for row in rows], left=pictures, label="truth")
    axes.axvline(pictures[0] + rows[0]["truth"], color="black", linewidth=0.8)
    axes.invert_yaxis()
    axes.set(xlabel="seconds per frame", title="each effect alone")
    axes.legend()

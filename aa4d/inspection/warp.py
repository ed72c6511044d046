"""DACW's maps beside the anchor histograms that they were built from."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure

from aa4d.methods.capabilities import WarpsCoordinates
from aa4d.methods.model_file import LoadedModel


def warp_figure(loaded: LoadedModel, coarse: LoadedModel | None) -> Figure | None:
    """On each axis the map u -> warped u, over histograms of the anchors at the map's making and of those now.

    None for a model that warps no coordinates.
    """
    model = loaded.model
    if not isinstance(model, WarpsCoordinates):
        return None
    boundaries = model.warp_boundaries().numpy()
    edges = np.linspace(-1, 1, boundaries.shape[1])
    figure = Figure(figsize=(12, 3.9), layout="constrained")
    sets = [("anchors now", loaded.model.resting(None), "C0")]
    if coarse is not None:
        sets.insert(0, ("anchors when the map was made", coarse.model.resting(None), "0.6"))
    for axis, axes in enumerate(figure.subplots(1, 3)):
        counts = axes.twinx()
        for label, position, color in sets:
            with torch.no_grad():
                # The box is the map's own: that of the model, also for the anchors of the coarse stage.
                u = model.field.normalise(position)[:, axis].numpy()
            density, _ = np.histogram(u, edges)
            filled = color != "C0" or len(sets) == 1
            counts.stairs(density / max(len(u), 1), edges, fill=filled, color=color, alpha=0.6, label=label)
        axes.set_zorder(counts.get_zorder() + 1)
        axes.patch.set_visible(False)
        axes.plot(edges, edges, color="0.3", lw=0.8, ls="--", label="identity")
        axes.plot(edges, boundaries[axis], color="C3", label="warped")
        axes.set(title="xyz"[axis], xlabel="u", xlim=(-1, 1), ylim=(-1, 1))
        if axis == 0:
            axes.set_ylabel("warped u")
            lines = [*axes.get_legend_handles_labels()[0], *counts.get_legend_handles_labels()[0]]
            figure.legend(lines, [str(x.get_label()) for x in lines], fontsize=8, loc="outside lower center", ncols=4)
        if axis == 2:
            counts.set_ylabel("share of the anchors in a bin")
    return figure


def stretch(loaded: LoadedModel) -> list[dict[str, float | str]]:
    """For each axis the largest and smallest slope of the map: how much capacity it gives and takes."""
    if not isinstance(loaded.model, WarpsCoordinates):
        return []
    boundaries = loaded.model.warp_boundaries().double().numpy()
    slopes = np.diff(boundaries, axis=1) * (boundaries.shape[1] - 1) / 2
    return [
        {"axis": axis, "most": float(slope.max()), "least": float(slope.min())}
        for axis, slope in zip("xyz", slopes, strict=True)
    ]

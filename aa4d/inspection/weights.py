"""ACFA's weights over time, for static and for dynamic anchors (the paper's figure 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from aa4d.field.planes import PLANES, SPATIOTEMPORAL
from aa4d.filming.layers import plane_weights
from aa4d.inspection.motion_groups import MotionGroups
from aa4d.methods.model_file import LoadedModel

SAMPLED_TIMES = 49


@dataclass(frozen=True)
class WeightsOverTime:
    """Weights on each plane, mean over channels; they sum to one over the planes."""

    times: NDArray[np.float64]  # [T]
    static: NDArray[np.float32]  # [T, static anchors, 6]
    dynamic: NDArray[np.float32]  # [T, dynamic anchors, 6]

    def groups(self) -> dict[str, NDArray[np.float32]]:
        return {"static anchors": self.static, "dynamic anchors": self.dynamic}


def weights_over_time(loaded: LoadedModel, groups: MotionGroups) -> WeightsOverTime | None:
    """None where the model's aggregation has no weights."""
    times = np.linspace(0, 1, SAMPLED_TIMES)
    sampled = [plane_weights(loaded.model, float(t)) for t in times]
    weights = [w.numpy() for w in sampled if w is not None]
    if len(weights) < len(times):
        return None
    every = np.stack(weights)
    return WeightsOverTime(times, every[:, groups.static], every[:, groups.dynamic])


def spatiotemporal(weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """[T, n, 6] -> [T, n]: the part on the planes with time; the rest lies on the spatial planes."""
    return weights[:, :, SPATIOTEMPORAL].sum(axis=2)


def weights_figure(weights: WeightsOverTime) -> Figure:
    """Means as lines and one standard deviation over the anchors as bands."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (name, group) in zip(panels, weights.groups().items(), strict=True):
        share = spatiotemporal(group)
        for label, values, color in (("spatial planes", 1 - share, "C0"), ("spatio-temporal planes", share, "C3")):
            if values.shape[1]:
                mean, deviation = values.mean(axis=1), values.std(axis=1)
                axes.plot(weights.times, mean, color=color, label=label)
                axes.fill_between(weights.times, mean - deviation, mean + deviation, color=color, alpha=0.2, lw=0)
        axes.axhline(0.5, color="0.6", lw=0.8, ls=":")
        axes.set(title=f"{name} ({group.shape[1]})", xlabel="t", xlim=(0, 1))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of the weight")
    panels[0].legend(fontsize=8)
    return figure


def planes_figure(weights: WeightsOverTime) -> Figure:
    """Mean weight on each of the six planes over anchors and time, with one standard deviation over the anchors."""
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    axes = figure.add_subplot()
    places = np.arange(len(PLANES))
    for side, (name, group) in zip((-0.2, 0.2), weights.groups().items(), strict=True):
        if group.shape[1]:
            of_anchor = group.mean(axis=0)
            axes.bar(places + side, of_anchor.mean(axis=0), 0.38, yerr=of_anchor.std(axis=0), label=name, capsize=2)
    axes.axhline(1 / len(PLANES), color="0.4", lw=0.8, ls=":")
    axes.set(xticks=places, xticklabels=PLANES, ylabel="weight")
    axes.legend(fontsize=8)
    return figure


def summary(weights: WeightsOverTime) -> list[dict[str, object]]:
    """One row for each group: anchors, and mean, deviation over anchors and change over the clip of the share."""
    rows: list[dict[str, object]] = []
    for name, group in weights.groups().items():
        share = spatiotemporal(group)
        if not share.shape[1]:
            rows.append({"name": name, "anchors": 0, "mean": None, "deviation": None, "first": None, "last": None})
            continue
        means = share.mean(axis=1)
        rows.append(
            {
                "name": name,
                "anchors": share.shape[1],
                "mean": float(share.mean()),
                "deviation": float(share.mean(axis=0).std()),
                "first": float(means[0]),
                "last": float(means[-1]),
            }
        )
    return rows

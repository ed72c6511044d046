"""Where things go: paths over a frame and from above, of rigid groups, or of the anchors that travel farthest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from aa4d.filming.layers import group_color
from aa4d.methods.model_file import LoadedModel
from aa4d.words import in_figure

SAMPLED_TIMES = 97  # of groups
ANCHOR_TIMES = 25  # of anchors, each of which decodes the field
FARTHEST_ANCHORS = 60
DOTS = 4000  # anchors drawn at most, evenly: more hide one another
HEADINGS = 4  # arrows along a path
ARROW_M = 4.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    name: str  # empty for an anchor
    color: tuple[float, float, float]
    times: Array  # [S] of t
    position_m: Array  # [S, 3]
    there: NDArray[np.bool_]  # [S]
    forward: Array | None  # [S, 3] unit, where it heads; None for an anchor


def trajectories(loaded: LoadedModel) -> list[Trajectory]:
    """Of every rigid group, or without groups of the anchors that travel farthest over the clip."""
    return _of_anchors(loaded) if loaded.model.groups is None else _of_groups(loaded)


def _of_groups(loaded: LoadedModel) -> list[Trajectory]:
    groups = loaded.model.groups
    assert groups is not None
    times = np.linspace(0, 1, SAMPLED_TIMES)
    with torch.no_grad():
        poses = [groups.pose(float(t)) for t in times]
        there = torch.stack([groups.presence(float(t)) > 0 for t in times]).numpy()
        position = torch.stack([p.position for p in poses]).double().numpy()  # [S, G, 3]
        # x of a group's frame points forward at heading 0, as an instance's does in its own (docs/formats.md).
        forward = torch.stack([p.rotation[:, :, 0] for p in poses]).double().numpy()
    world = position * loaded.frame.unit_m + loaded.frame.origin_m
    return [
        Trajectory(name, group_color(g), times, world[:, g], there[:, g], forward[:, g])
        for g, name in enumerate(groups.names)
    ]


def _of_anchors(loaded: LoadedModel) -> list[Trajectory]:
    times = np.linspace(0, 1, ANCHOR_TIMES)
    with torch.no_grad():
        centres = torch.stack([loaded.model.centers(float(t)) for t in times]).double().numpy()  # [S, N, 3]
    travelled = np.linalg.norm(np.diff(centres, axis=0), axis=2).sum(axis=0)
    chosen = np.argsort(-travelled, kind="stable")[:FARTHEST_ANCHORS]
    world = centres[:, chosen] * loaded.frame.unit_m + loaded.frame.origin_m
    there = np.ones(len(times), bool)
    return [Trajectory("", group_color(i), times, world[:, i], there, None) for i in range(len(chosen))]


def over_frame_figure(
    loaded: LoadedModel, picture: NDArray[np.uint8], index: int, paths: list[Trajectory], label: str
) -> Figure:
    """The paths as frame `index` sees them, over `picture` [H, W, 3], with the anchors that ride where they are."""
    frame, pinhole = loaded.frames[index], loaded.camera
    figure = Figure(figsize=(8, 8 * pinhole.height / pinhole.width + 0.3), layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(picture, extent=(0, pinhole.width, pinhole.height, 0), alpha=0.6)
    for path in paths:
        pixels = _pixels(loaded, index, path.position_m)
        seen = np.where(path.there[:, None], pixels, np.nan)
        axes.plot(*seen.T, color=path.color, lw=1.2)
        now = int(np.argmin(np.abs(path.times - frame.t)))
        if path.there[now] and np.isfinite(pixels[now]).all():
            axes.plot(*pixels[now], "o", color=path.color, ms=4, mec="black", mew=0.5)
            _annotate(axes, path, pixels[now], (pinhole.width, pinhole.height))
    _dots(loaded, index, axes)
    axes.set(xlim=(0, pinhole.width), ylim=(pinhole.height, 0), xticks=[], yticks=[], title=label)
    axes.title.set_fontsize(9)
    return figure


def map_figure(loaded: LoadedModel, paths: list[Trajectory]) -> Figure:
    """From above, metres: paths from their start (ring) to their end (square), headings, cameras, still anchors."""
    figure = Figure(figsize=(8, 7), layout="constrained")
    axes = figure.add_subplot()
    member = loaded.model.group
    with torch.no_grad():
        still = loaded.model.resting(None).double().numpy() * loaded.frame.unit_m + loaded.frame.origin_m
    if member is not None:
        still = still[member.numpy() < 0]
    still = still[:: max(len(still) // DOTS, 1)]
    axes.plot(still[:, 0], still[:, 1], ".", color="0.8", ms=1, zorder=0)
    for path in paths:
        shown = np.flatnonzero(path.there)
        if not len(shown):
            continue
        ways = np.where(path.there[:, None], path.position_m, np.nan)
        axes.plot(ways[:, 0], ways[:, 1], color=path.color, lw=1.3)
        for end, marker in ((shown[0], "o"), (shown[-1], "s")):
            fill = "none" if marker == "o" else path.color
            axes.plot(*path.position_m[end, :2], marker, ms=5 if path.name else 2, color=path.color, mfc=fill)
        if path.forward is not None:
            at = shown[np.linspace(0, len(shown) - 1, HEADINGS).round().astype(int)]
            arrows = path.forward[at, :2] * ARROW_M
            axes.quiver(
                *path.position_m[at, :2].T, *arrows.T, color=path.color, angles="xy", scale_units="xy", scale=1,
                width=0.003,
            )  # fmt: skip
        if path.name:
            x, y = path.position_m[shown[0], :2]
            axes.annotate(in_figure(path.name), (x, y), fontsize=6, xytext=(4, 4), textcoords="offset points")
    cameras = np.stack([np.linalg.inv(frame.viewmat)[:3, 3] for frame in loaded.frames])
    axes.plot(cameras[:, 0], cameras[:, 1], "-^", color="black", lw=0.8, ms=3, label="cameras")
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def _pixels(loaded: LoadedModel, index: int, position_m: Array) -> Array:
    """[S, 2], NaN behind the camera."""
    viewmat = loaded.frames[index].viewmat
    in_camera = position_m @ viewmat[:3, :3].T + viewmat[:3, 3]
    ahead = in_camera[:, 2] > 1e-6
    pixels = in_camera @ loaded.camera.K.T / np.where(ahead, in_camera[:, 2], 1)[:, None]
    return np.where(ahead[:, None], pixels[:, :2], np.nan)


def _annotate(axes: Axes, path: Trajectory, at: Array, size: tuple[int, int]) -> None:
    if path.name and 0 <= at[0] < size[0] and 0 <= at[1] < size[1]:
        axes.annotate(
            path.name, (at[0], at[1]), fontsize=6, color="white", xytext=(3, 3), textcoords="offset points",
            bbox={"facecolor": "black", "alpha": 0.5, "lw": 0, "pad": 0.5},
        )  # fmt: skip


def _dots(loaded: LoadedModel, index: int, axes: Axes) -> None:
    """The anchors that ride, each in its group's colour, at the time of the frame."""
    member, t = loaded.model.group, loaded.frames[index].t
    present = loaded.model.present(t)
    if member is None or present is None:
        return
    riders = ((member >= 0) & present).nonzero()[:, 0]
    riders = riders[:: max(len(riders) // DOTS, 1)]
    with torch.no_grad():
        centres = loaded.model.centers(t)[riders].double().numpy()
    pixels = _pixels(loaded, index, centres * loaded.frame.unit_m + loaded.frame.origin_m)
    axes.scatter(pixels[:, 0], pixels[:, 1], s=0.8, c=[group_color(int(g)) for g in member[riders]], lw=0)

"""Layers that a picture can show of a model: one entry a layer."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import matplotlib
import numpy as np
import torch
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray
from torch import Tensor

from aa4d.capture.schema import PinholeCamera
from aa4d.errors import InputError
from aa4d.field.planes import SPATIOTEMPORAL
from aa4d.filming.camera_path import View
from aa4d.kernels.plane_lookup import PLANES
from aa4d.methods.capabilities import WeighsPlanes
from aa4d.methods.model_file import LoadedModel
from aa4d.methods.rendering import render
from aa4d.methods.scene_model import SceneModel
from aa4d.raster.types import Output, Rendering

NOTHING = 0.01  # alpha below which a pixel shows nothing to colour
BLACK = (0, 0, 0)  # what such a pixel gets
WORLD_GRAY = (0.35, 0.35, 0.35)
GOLDEN = 0.618034  # fraction of a turn from one group's hue to the next


@dataclass(frozen=True)
class Ramp:
    """How a scalar is drawn in colours."""

    meaning: str
    unit: str
    colormap: str


@dataclass(frozen=True)
class Layer(Ramp):
    """A scalar per pixel. `values` [H, W] from a rendering, in `unit`, NaN where nothing is."""

    values: Callable[[LoadedModel, Rendering], Tensor]
    anchor_values: Callable[[LoadedModel, float | None], Tensor] | None = None  # [N] painted for it, if any
    bounds: tuple[float, float] | None = None  # of the colour scale; None: measured over the views
    from_zero: bool = False  # the scale begins at 0


def spatiotemporal_share(loaded: LoadedModel, t: float | None) -> Tensor:
    """[N] in [0, 1]: the part of each anchor's aggregation weights that lies on the planes with time.

    Raises:
        InputError: a model whose aggregation has no weights.
    """
    return _weights_on(SPATIOTEMPORAL, loaded, t)


def _weights_on(planes: Sequence[int], loaded: LoadedModel, t: float | None) -> Tensor:
    """[N] in [0, 1]: the part of each anchor's aggregation weights that lies on some of `PLANES`."""
    weights = None if t is None else plane_weights(loaded.model, t)
    if weights is None:
        raise InputError(f"{loaded.path}: has no aggregation weights, so no activity to show; choose the layer motion")
    return weights[:, planes].sum(1)


def plane_weights(model: SceneModel, t: float) -> Tensor | None:
    """[N, 6] weights over the planes, mean over channels; None for a model that weighs none."""
    return model.plane_weights(t) if isinstance(model, WeighsPlanes) else None


def displacement_m(loaded: LoadedModel, t: float | None) -> Tensor:
    """[N] how far each anchor's centre stands from its canonical place at time t, in metres.

    Of an anchor that rides on a group, the canonical place is where the group's reference pose puts it.
    """
    with torch.no_grad():
        moved = loaded.model.centers(t) - loaded.model.centers(None)
    return moved.norm(dim=1) * loaded.frame.unit_m


def speed_mps(loaded: LoadedModel, t: float | None) -> Tensor:
    """[N] how fast each anchor's centre moves at time t, in metres a second: over half a frame to each side of it."""
    frames = len(loaded.frames) - 1
    if t is None or frames < 1:
        return torch.zeros(len(loaded.model), device=loaded.model.device)
    before, after = max(t - 0.5 / frames, 0.0), min(t + 0.5 / frames, 1.0)
    with torch.no_grad():
        moved = loaded.model.centers(after) - loaded.model.centers(before)
    return moved.norm(dim=1) * (loaded.frame.unit_m / (loaded.seconds_at(after) - loaded.seconds_at(before)))


def mover_colors(loaded: LoadedModel) -> Tensor:
    """[N, 3] sRGB in [0, 1]: the colour of each anchor's group, grey for the world's.

    Raises:
        InputError: a model without groups.
    """
    groups, group = loaded.model.groups, loaded.model.group
    if groups is None or group is None:
        raise InputError(f"{loaded.path}: has no rigid groups, so no movers to show; choose the layer motion")
    palette = torch.tensor([group_color(g) for g in range(len(groups))] + [WORLD_GRAY], device=group.device)
    return palette[group]  # -1, the world, is the last


def group_color(group: int) -> tuple[float, float, float]:
    """sRGB in [0, 1]; any two groups of successive numbers differ much, and no two have the same hue."""
    red, green, blue = hsv_to_rgb((group * GOLDEN % 1, 0.8, 1.0))
    return float(red), float(green), float(blue)


def _painted(_loaded: LoadedModel, rendering: Rendering) -> Tensor:
    """The mean over what a pixel shows, of what the anchors were painted with."""
    assert rendering.features is not None
    return rendering.features[..., 0] / rendering.alpha.clamp_min(NOTHING)


def _depth(loaded: LoadedModel, rendering: Rendering) -> Tensor:
    assert rendering.depth is not None
    return rendering.depth * loaded.frame.unit_m


# Scalars.
LAYERS: dict[str, Layer] = {
    "depth": Layer("distance along the camera's axis", "m", "turbo_r", _depth),
    "alpha": Layer("how opaque", "", "gray", lambda _, r: r.alpha, bounds=(0.0, 1.0)),
    "activity": Layer("share of the weight on planes with time", "", "viridis", _painted, spatiotemporal_share),
    "motion": Layer("distance from the canonical place", "m", "inferno", _painted, displacement_m, from_zero=True),
    "speed": Layer("how fast anchors move", "m/s", "inferno", _painted, speed_mps, from_zero=True),
    **{
        f"weight-{name}": Layer(
            f"share of the weight on the plane {name}", "", "viridis", _painted, partial(_weights_on, [p])
        )
        for p, name in enumerate(PLANES)
    },
}

# Pictures: anchors painted with colours, which need no scale. [N, 3] sRGB in [0, 1].
PAINTINGS: dict[str, Callable[[LoadedModel], Tensor]] = {"movers": mover_colors}

# The names of all that `draw` draws, in order.
NAMES = ChainMap[str, object](PAINTINGS, LAYERS, {"color": None})  # type: ignore[arg-type]


@dataclass(frozen=True)
class Drawn:
    color: NDArray[np.uint8]  # [H, W, 3]
    values: dict[str, NDArray[np.float32]]  # by layer, [H, W], NaN where nothing is
    paintings: dict[str, NDArray[np.uint8]]  # by layer, [H, W, 3], black where nothing is

    def picture(self, name: str, scale: tuple[float, float] | None) -> NDArray[np.uint8]:
        """[H, W, 3] of the layer `name`; `scale` for those in `LAYERS`."""
        if name == "color":
            return self.color
        if name in self.paintings:
            return self.paintings[name]
        assert scale is not None
        return colored(LAYERS[name], self.values[name], scale)


def draw(loaded: LoadedModel, view: View, pinhole: PinholeCamera, names: list[str]) -> Drawn:
    """Colour and the layers of `names` that are in `LAYERS` or `PAINTINGS`; what is not asked for is not computed."""
    layers = {name: LAYERS[name] for name in names if name in LAYERS}
    t = None if loaded.is_static else view.t
    camera = loaded.frame.camera(view.viewmat, pinhole.K, pinhole.width, pinhole.height)
    painted = {name: layer.anchor_values(loaded, t)[:, None] for name, layer in layers.items() if layer.anchor_values}
    painted |= {name: PAINTINGS[name](loaded) for name in names if name in PAINTINGS}
    outputs: tuple[Output, ...] = ("depth",) if "depth" in layers else ()
    values, paintings = {}, {}
    with torch.no_grad():
        rendering = render(
            loaded.model,
            t,
            camera,
            torch.tensor(loaded.background),
            outputs=outputs,
            unit_features=torch.cat(list(painted.values()), dim=1) if painted else None,
        ).rendering
        shown = rendering.alpha >= NOTHING
        for name, layer in layers.items():
            value = layer.values(loaded, _of_layer(rendering, painted, name))
            values[name] = torch.where(shown, value, torch.nan).numpy() if name != "alpha" else value.numpy()
        for name in names:
            if name in PAINTINGS:
                features = _of_layer(rendering, painted, name).features
                assert features is not None
                paintings[name] = _as_bytes(features / rendering.alpha.clamp_min(NOTHING)[..., None] * shown[..., None])
    return Drawn(_as_bytes(rendering.color), values, paintings)


def _as_bytes(color: Tensor) -> NDArray[np.uint8]:
    return (color.clamp(0, 1) * 255).round().byte().numpy()


def _of_layer(rendering: Rendering, painted: dict[str, Tensor], name: str) -> Rendering:
    """The rendering with this layer's painted channels alone."""
    if name not in painted or rendering.features is None:
        return rendering
    widths = [value.shape[1] for value in painted.values()]
    of_layer = rendering.features.split(widths, dim=-1)[list(painted).index(name)]
    return replace(rendering, features=of_layer)


def scale_of(layer: Layer, samples: list[NDArray[np.float32]]) -> tuple[float, float]:
    """Lower and upper end of the colour scale: fixed, or the 1st and 99th percentile of what some views show."""
    if layer.bounds is not None:
        return layer.bounds
    values = np.concatenate([s[np.isfinite(s)] for s in samples]) if samples else np.zeros(0)
    if not len(values):
        return 0.0, 1.0
    lower, upper = (float(v) for v in np.percentile(values, (1, 99)))
    if layer.from_zero:
        lower = 0.0
    # A scene without any difference still has a scale.
    return (lower, upper) if upper - lower > 1e-6 * max(abs(lower), abs(upper), 1e-6) else (lower, lower + 1.0)


def colored(ramp: Ramp, values: NDArray[np.float32], scale: tuple[float, float]) -> NDArray[np.uint8]:
    """[H, W] -> [H, W, 3]; beyond the scale its ends' colours, black where nothing is."""
    lower, upper = scale
    colormap = matplotlib.colormaps[ramp.colormap]
    # A table of its colours, which is what a colormap looks up: many times quicker than to ask it for each pixel.
    table = np.append((colormap(np.arange(colormap.N))[:, :3] * 255).round().astype(np.uint8), [BLACK], axis=0)
    share = np.clip((np.nan_to_num(values) - lower) / (upper - lower), 0, 1)
    index = np.minimum((share * colormap.N).astype(np.int32), colormap.N - 1)
    return table[np.where(np.isfinite(values), index, colormap.N)].astype(np.uint8)

"""The effects that a scene may name with `[effects.NAME]`, each a file of its own in this folder.

Here stand only their names. A file is imported when a scene names its effect; deleting the file changes nothing for
the scenes that do not. Each file says

- `Settings`: the keys of its table, a frozen dataclass of `synth.checking.key` fields;
- `STAGE`: when it runs, one of `STAGES`; `COST` and `TRUTH`: what it costs and which truth it touches, in words;
- one function for its stage (see `STAGES`);
- where it hides what the lens sees, in the same pixels of every frame, `covers(settings, plan) -> mask [H, W]`, which
  is written to left_out/all.png.
"""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from types import ModuleType
from typing import Any

from synth.errors import InputError

STAGES = {
    "pose": "fly(settings, flight, seed) -> flight: changes where the camera is, at any real time",
    "scene": "stage(settings, plan) -> Staging: what Blender builds and animates besides, and the instances it adds",
    "shutter": "shut(settings, shutter, fps) -> Shutter: how long and in which order the rows are exposed",
    "lens": "lens(settings, K, size) -> Lens: where a ray meets the picture; all passes follow",
    "film": "expose(settings, linear, shot) -> linear: acts on linear light before it becomes eight bits",
    "encode": "encode(settings, plan, folder): acts on the finished frames",
    "capture": "measure(settings, plan) -> viewmats [N, 4, 4]: what the capture says about the camera",
}

NAMES = (  # in the order in which those of one stage apply
    "position_sway",
    "gimbal_jitter",
    "wind",
    "cloud_shadow",
    "wet_road",
    "signal_lamps",
    "indicator_lights",
    "motion_blur",
    "rolling_shutter",
    "lens_distortion",
    "haze",
    "vignetting",
    "exposure_drift",
    "sensor_noise",
    "burned_in_text",
    "video_compression",
    "pose_noise",
)


@dataclass(frozen=True)
class Effect:
    """An effect that a scene names, with its checked settings."""

    name: str
    settings: Any
    module: ModuleType = field(repr=False, compare=False)

    @property
    def stage(self) -> str:
        return str(self.module.STAGE)


def choose(tables: Mapping[str, Any], source: str) -> tuple[Effect, ...]:
    """The effects of the tables `[effects.NAME]` of the scene file `source`, in the order in which they apply.

    Raises:
        InputError: an unknown effect, or settings that it does not take.
    """
    for name in tables:
        if name not in NAMES:
            near = difflib.get_close_matches(name, NAMES, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"{source}: effects.{name}: unknown effect; {hint}there are: {', '.join(NAMES)}.")
    return tuple(_load(name, tables[name], source) for name in NAMES if name in tables)


def at(effects: tuple[Effect, ...], stage: str) -> Iterator[Effect]:
    """Those of one stage."""
    return (effect for effect in effects if effect.stage == stage)


def _load(name: str, table: Any, source: str) -> Effect:
    from synth.checking import check

    try:
        module = import_module(f"synth.effects.{name}")
    except ModuleNotFoundError as error:
        if error.name != f"synth.effects.{name}":
            raise
        raise InputError(f"{source}: effects.{name}: its file synth/effects/{name}.py is not installed.") from None
    return Effect(name, check(module.Settings, table, f"effects.{name}", source), module)

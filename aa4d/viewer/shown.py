"""What a viewer shows of a run: its model, the capture's own pictures, where things go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from aa4d.capture.schema import PinholeCamera
from aa4d.errors import InputError
from aa4d.filming.camera_path import View
from aa4d.filming.layers import LAYERS, PAINTINGS, draw
from aa4d.inspection.trajectories import trajectories
from aa4d.methods.model_file import LoadedModel
from aa4d.viewer.cameras import Array, point_at
from aa4d.viewer.footage import Footage
from aa4d.viewer.ribbons import Ribbon, ribbon_of

OF_FOOTAGE = ("error", "frame")  # layers that need the capture's pictures
WINDOW = 5  # pixels
RIBBON_WIDTH = 0.006  # of the model's unit, the distance at which cameras see the scene


@dataclass(frozen=True, eq=False)
class Shown:
    name: str  # of its run
    loaded: LoadedModel
    state: str  # how far its training is, for people
    footage: Footage | None  # None where the capture is not there

    def t_at(self, second: float) -> float:
        """t in [0, 1] at a second of the clip."""
        frames = self.loaded.frames
        return float(np.interp(second, [f.time_s for f in frames], [f.t for f in frames]))

    @cached_property
    def ribbons(self) -> tuple[Ribbon, ...]:
        """Of the rigid groups, or without groups of what the model moves farthest; of a static model none."""
        if self.loaded.is_static:
            return ()
        width_m = RIBBON_WIDTH * self.loaded.frame.unit_m
        return tuple(ribbon_of(path, width_m) for path in trajectories(self.loaded))

    @cached_property
    def lacking(self) -> dict[str, str]:
        """By the name of a layer that cannot be drawn of it, why."""
        loaded, reasons = self.loaded, {}
        t = None if loaded.is_static else loaded.frames[0].t
        painted = {
            name: partial(layer.anchor_values, loaded, t) for name, layer in LAYERS.items() if layer.anchor_values
        }
        for name, paint in (painted | {name: partial(paint, loaded) for name, paint in PAINTINGS.items()}).items():
            try:
                paint()
            except InputError as error:
                reasons[name] = str(error).removeprefix(f"{loaded.path}: ")
        if self.footage is None:
            reasons |= dict.fromkeys(OF_FOOTAGE, "the capture is not there; --capture says where it lies")
        return reasons

    def point_at(self, pixel: tuple[float, float], viewmat: Array, camera: PinholeCamera, t: float) -> Array | None:
        """[3] metres: what a camera sees at a pixel; None for nothing."""
        K = camera.K.copy()
        K[:2, 2] += WINDOW / 2 - np.array(pixel)  # of the same picture a few pixels around that one
        window = PinholeCamera(WINDOW, WINDOW, K)
        depth = draw(self.loaded, View("", t, viewmat), window, ["depth"]).values["depth"]
        if not np.isfinite(depth).any():
            return None
        return point_at(pixel, float(np.nanmedian(depth)), viewmat, camera)

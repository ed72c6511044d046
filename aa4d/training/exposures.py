"""Exposures that are learned with the scene (`--set exposure=true`): the camera's own brightness and white balance.

A drone's camera meters anew as it flies. Every training view has an affine map of color, c' = M c + b, that starts at
the identity and is learned from the same loss as the scene. The scene may be brighter with all views darker: the mean
of the maps is kept at the identity.

A held-out frame has no map of its own, for that would take its pixels: it gets the one between its neighbors in time.
Views that are no frame of the capture have none.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from aa4d.capture.reader import Capture
from aa4d.methods.rendering import Rendered, exposed
from aa4d.methods.settings import Decay
from aa4d.training.per_view import PerView


class Exposures(PerView):
    """Those of N training views."""

    part, name = "exposures", "maps"

    def __init__(self, count: int, rate: Decay, device: torch.device) -> None:
        super().__init__(torch.eye(3, 4, device=device).expand(count, 3, 4), rate)

    def of(self, index: int, rendered: Rendered) -> Rendered:
        """What the training view of that index shows of `rendered`; carries gradients."""
        color = exposed(rendered.rendering.color, self.of_views[index])
        return dataclasses.replace(rendered, rendering=dataclasses.replace(rendered.rendering, color=color))

    def fix_gauge(self) -> None:
        self.set_to(self._free())

    def values(self) -> NDArray[np.float64]:
        """[N, 3, 4], their mean the identity."""
        free: NDArray[np.float64] = self._free().double().cpu().numpy()
        return free

    def _free(self) -> Tensor:
        values = self.stacked()
        return values - values.mean(0) + torch.eye(3, 4, device=values.device)


def with_exposures(capture: Capture, values: NDArray[np.float64]) -> Capture:
    """The capture with maps [N, 3, 4] of its training frames; held-out ones have those between."""
    known = np.array([capture.frames[i].t for i in capture.of_split("train")])
    flat = values.reshape(len(values), 12)
    frames = []
    for f in capture.frames:
        exposure = np.array([np.interp(f.t, known, column) for column in flat.T]).reshape(3, 4)
        frames.append(dataclasses.replace(f, exposure=exposure))
    return dataclasses.replace(capture, frames=tuple(frames))

"""Where a ray meets the picture. The pinhole; `effects/lens_distortion.py` has the other one."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Lens(Protocol):
    """A camera without its pose. Its pictures are made from a pinhole's that is wider by `margin_px` on each side."""

    @property
    def K(self) -> Array: ...  # noqa: N802

    def __hash__(self) -> int: ...

    @property
    def margin_px(self) -> tuple[int, int]: ...

    def project(self, local: Array) -> Array:
        """Pixel coordinates [..., 2] of points [..., 3] in camera axes; NaN where none is in front of the lens."""

    def rays(self, uv: Array) -> Array:
        """Points [..., 3] at depth 1 that are seen at pixel coordinates [..., 2]."""

    def document(self) -> dict[str, Any]:
        """`model`, `K` and its parameters, as in capture.json."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """No distortion."""

    K: Array  # [3, 3]
    margin_px: tuple[int, int] = (0, 0)

    def project(self, local: Array) -> Array:
        depth = np.where(local[..., 2] > 0, local[..., 2], np.nan)
        return local[..., :2] / depth[..., None] * np.diag(self.K)[:2] + self.K[:2, 2]

    def rays(self, uv: Array) -> Array:
        xy = (uv - self.K[:2, 2]) / np.diag(self.K)[:2]
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)

    def document(self) -> dict[str, Any]:
        return {"model": "PINHOLE", "K": self.K.tolist()}


@lru_cache(maxsize=2)
def pixel_rays(lens: Lens, size: tuple[int, int]) -> Array:
    """Points at depth 1 [H, W, 3] that the centres of the pixels of a picture of `size` (width, height) see."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    rays = lens.rays(np.stack([x, y], axis=-1))
    rays.setflags(write=False)  # shared by all who ask
    return rays

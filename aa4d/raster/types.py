"""What every rasteriser back end takes and gives. Conventions: docs/formats.md."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians in the frame of the camera's `viewmat`."""

    means: Tensor  # [N, 3]
    quaternions: Tensor  # [N, 4] w x y z, any non-zero length: normalised by the rasteriser
    scales: Tensor  # [N, 3] standard deviations along the Gaussian's own axes, positive
    opacities: Tensor  # [N] in [0, 1]
    colors: Tensor  # [N, 3] sRGB in [0, 1]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel centres at + 0.5."""

    viewmat: Tensor  # [4, 4] world to camera, OpenCV axes
    K: Tensor  # [3, 3] intrinsics in pixels
    width: int
    height: int
    near: float = 0.01


@dataclass(frozen=True)
class Rendering:
    """One image.

    `radii` and `screen_gradient` are for densification: `radii` is zero where a Gaussian was culled, and
    `screen_gradient` is filled by the backward pass with the norm of the gradient with respect to the Gaussian's
    projected centre in normalised device units (pixel gradient times width / 2 and height / 2).
    """

    color: Tensor  # [H, W, 3], composited over the background
    alpha: Tensor  # [H, W]
    depth: Tensor | None  # [H, W] expected depth_z: sum(w z) / sum(w); None unless asked for
    radii: Tensor  # [N] int32, pixels
    screen_gradient: Tensor  # [N]

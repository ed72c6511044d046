"""Inputs and outputs of every rasteriser back end. Conventions: docs/formats.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from torch import Tensor


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians in the frame of the camera's `viewmat`."""

    means: Tensor  # [N, 3]
    quaternions: Tensor  # [N, 4] w x y z, any non-zero length: normalised by the rasteriser
    scales: Tensor  # [N, 3] standard deviations along the Gaussian's own axes, positive
    opacities: Tensor  # [N] in [0, 1]
    colors: Tensor  # [N, 3] sRGB in [0, 1]
    features: Tensor | None = None  # [N, F] anything else to draw, F at most 32


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel centres at + 0.5."""

    viewmat: Tensor  # [4, 4] world to camera, OpenCV axes
    K: Tensor  # [3, 3] intrinsics in pixels
    width: int
    height: int
    near: float = 0.01


# What is drawn or gathered only when it is asked for.
Output = Literal["depth", "absolute_gradient", "sensitivity"]
OUTPUTS: tuple[Output, ...] = get_args(Output)


@dataclass(frozen=True)
class Options:
    """Options of a rendering. What is not asked for costs nothing.

    `mode`: "antialiased" scales opacity so that the screen's low-pass filter adds none (Mip-Splatting, Yu et al. 2024).
    `precision`: "fast" has gsplat's cut-offs, "exact" far tighter ones: docs/rasteriser.md says what each leaves out.
    `outputs`: "depth" fills `Rendering.depth`, "absolute_gradient" `Rendering.screen_gradient_absolute`, "sensitivity"
        `Rendering.sensitivity`.
    `mask_invalid`: leave out a Gaussian that holds a NaN or an infinity, rather than refuse the scene.
    """

    outputs: frozenset[Output] = frozenset()
    mode: Literal["classic", "antialiased"] = "classic"
    precision: Literal["fast", "exact"] = "fast"
    mask_invalid: bool = False


@dataclass(frozen=True)
class Rendering:
    """One image.

    `radii` and the screen gradients are for densification: `radii` is zero where a Gaussian was culled, and
    `screen_gradient` is filled by the backward pass with the norm of the gradient with respect to the Gaussian's
    projected centre in normalised device units (pixel gradient times width / 2 and height / 2).
    `screen_gradient_absolute` sums each component's absolute value over the pixels first (AbsGS, Ye et al. 2024).
    `sensitivity` is the sum over pixels of the squared gradient with respect to the Gaussian's falloff there, opacity
    times that of alpha, whether or not alpha's bound binds; it asks for a gradient of `opacities`.
    A second backward pass overwrites all three.
    """

    color: Tensor  # [H, W, 3], composited over the background
    alpha: Tensor  # [H, W]
    depth: Tensor | None  # [H, W] expected depth_z: sum(w z) / sum(w), zero where nothing is; None unless asked for
    radii: Tensor  # [N] int32, pixels
    screen_gradient: Tensor  # [N]
    screen_gradient_absolute: Tensor | None = None  # [N]; None unless asked for
    sensitivity: Tensor | None = None  # [N]; likewise
    features: Tensor | None = None  # [H, W, F] sum(w f); None if the Gaussians have none

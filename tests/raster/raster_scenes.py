"""Scenes for the rasteriser's tests, and the comparison of a back end with the float64 reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from aa4d.raster import Camera, Gaussians, Options, Rendering, rasterize, reference
from aa4d.raster.constants import MAX_ALPHA
from aa4d.raster.cutoffs import CUTOFFS

BACKGROUND = torch.tensor([0.25, 0.5, 0.75], dtype=torch.float64)  # exact in float32, as everything below


def camera(width: int = 70, height: int = 45, focal: float = 60.0, **changes: Any) -> Camera:
    """A camera near the origin that looks along z, turned and moved a little: no entry of its pose is special."""
    angle = torch.tensor(0.1, dtype=torch.float64)
    c, s = torch.cos(angle), torch.sin(angle)
    viewmat = torch.tensor([[c, 0, s, 0.1], [0, 1, 0, -0.05], [-s, 0, c, 0.2], [0, 0, 0, 1]], dtype=torch.float64)
    K = torch.tensor([[focal, 0, width / 2], [0, focal * 1.05, height / 2], [0, 0, 1]], dtype=torch.float64)
    return replace(Camera(viewmat, K, width, height), **changes)


def straight_camera(width: int = 40, height: int = 30, focal: float = 32.0, **changes: Any) -> Camera:
    """A camera at the origin that looks along z."""
    K = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], dtype=torch.float64)
    return replace(Camera(torch.eye(4, dtype=torch.float64), K, width, height), **changes)


def random_gaussians(count: int, seed: int = 0, size: float = 0.15, features: int | None = None) -> Gaussians:
    """Gaussians in front of `camera()`, some partly outside the image."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    depth = 1.5 + 4 * uniform(count, 1)
    sideways = (uniform(count, 2) - 0.5) * torch.tensor([1.6, 1.0]) * depth
    return Gaussians(
        means=torch.cat([sideways, depth], -1).double(),
        quaternions=normal(count, 4).double(),
        scales=(size * torch.exp(0.7 * normal(count, 3))).double(),
        opacities=(0.05 + 0.9 * uniform(count)).double(),
        colors=uniform(count, 3).double(),
        features=None if features is None else normal(count, features).double(),
    )


def one_gaussian(**changes: Any) -> Gaussians:
    """A plain Gaussian four units in front of `straight_camera()`; a change may be a list of rows."""
    values: dict[str, Any] = {
        "means": [[0.1, -0.2, 4.0]],
        "quaternions": [[0.9, 0.1, -0.3, 0.2]],
        "scales": [[0.3, 0.2, 0.4]],
        "opacities": [0.5],
        "colors": [[0.2, 0.4, 0.6]],
    } | changes
    count = max(len(value) for value in values.values())
    tensors = {name: torch.tensor(value, dtype=torch.float32).double() for name, value in values.items()}
    return Gaussians(**{name: value.expand(count, *value.shape[1:]).clone() for name, value in tensors.items()})


def leaves(gaussians: Gaussians, dtype: torch.dtype) -> Gaussians:
    """A copy whose tensors are leaves that require gradients."""
    tensors = {name: value for name, value in vars(gaussians).items() if value is not None}
    return Gaussians(**{name: value.detach().to(dtype).requires_grad_() for name, value in tensors.items()})


def maps(image: Rendering) -> Tensor:
    """[H, W, C] every map of a rendering, side by side."""
    parts = [image.color, image.alpha[..., None]]
    if image.depth is not None:
        parts.append(image.depth[..., None])
    if image.features is not None:
        parts.append(image.features)
    return torch.cat(parts, dim=-1)


def draw(
    gaussians: Gaussians, cam: Camera, backend: str, weights: Tensor | None = None, **options: Any
) -> tuple[Rendering, dict[str, Tensor]]:
    """Render, and take the gradient of a functional of all maps: `weights` [H, W, C], random ones by default."""
    dtype = torch.float64 if backend == "reference" else torch.float32
    inputs = leaves(gaussians, dtype)
    background = BACKGROUND.to(dtype, copy=True).requires_grad_()
    viewmat = cam.viewmat.detach().clone().requires_grad_()
    image = rasterize(inputs, replace(cam, viewmat=viewmat), background=background, backend=backend, **options)
    values = maps(image)
    if weights is None:
        weights = random_weights(cam, values.shape[-1])
    (values.double() * weights).sum().backward()
    gradients = {name: value.grad for name, value in vars(inputs).items() if value is not None}
    return image, gradients | {"background": background.grad, "viewmat": viewmat.grad}


def random_weights(cam: Camera, channels: int) -> Tensor:
    generator = torch.Generator().manual_seed(5)
    return torch.randn(cam.height, cam.width, channels, generator=generator, dtype=torch.float64)


def undecided_pixels(gaussians: Gaussians, cam: Camera, margin: float = 1e-5, **options: Any) -> Tensor:
    """[H, W] where float32 and float64 may rightly disagree: a contribution lies on one of the hard thresholds."""
    settings = Options(**options)
    cutoffs = CUTOFFS[settings.precision]
    projected = reference.project(gaussians, cam, settings.mode == "antialiased", cutoffs)
    y, x = torch.meshgrid(torch.arange(cam.height) + 0.5, torch.arange(cam.width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], dim=-1).reshape(-1, 2).double()
    dx, dy = (pixels[:, None, :] - projected.centers).unbind(-1)
    alpha = projected.opacities * torch.exp(-reference.mahalanobis(projected, dx, dy) / 2)
    kept = torch.where(alpha >= cutoffs.alpha, alpha.clamp(max=MAX_ALPHA), 0)
    behind = torch.cumprod(1 - kept, dim=-1)

    def close(values: Tensor, threshold: float) -> Tensor:
        return ((values / threshold - 1).abs() < margin).any(dim=-1)

    undecided = close(alpha, cutoffs.alpha) | close(alpha, MAX_ALPHA) | close(behind, cutoffs.transmittance)
    return undecided.reshape(cam.height, cam.width)


def relative_error(value: Tensor, truth: Tensor) -> float:
    """Of a whole tensor, in the Euclidean norm; absolute where the truth is zero."""
    error, scale = (value.double() - truth.double()).norm(), truth.double().norm()
    return float(error / scale) if scale > 0 else float(error)


def errors_against_reference(
    gaussians: Gaussians, cam: Camera, **options: Any
) -> tuple[Rendering, dict[str, Tensor], dict[str, float]]:
    """What the native back end draws, its gradients, and how far each differs from the reference, by name.

    The maps ("maps") by the largest difference, relative where a value is over one; gradients in the norm.
    """
    decided = ~undecided_pixels(gaussians, cam, **options)
    assert decided.float().mean() > 0.9
    channels = (
        4 + ("depth" in options.get("outputs", ())) + (0 if gaussians.features is None else gaussians.features.shape[1])
    )
    weights = random_weights(cam, channels) * decided[..., None]
    truth, truth_gradients = draw(gaussians, cam, "reference", weights, **options)
    image, gradients = draw(gaussians, cam, "native", weights, **options)
    assert torch.equal(image.radii, truth.radii)
    values, true_values = maps(image).detach().double(), maps(truth).detach()
    off = ((values - true_values).abs() / (1 + true_values.abs())) * decided[..., None]
    errors = {"maps": float(off.max()) if values.isfinite().all() else float("inf")}
    pairs = {f"d/d({name})": (gradient, truth_gradients[name]) for name, gradient in gradients.items()}
    pairs["screen_gradient"] = image.screen_gradient, truth.screen_gradient
    if "absolute_gradient" in options.get("outputs", ()):
        pairs["screen_gradient_absolute"] = image.screen_gradient_absolute, truth.screen_gradient_absolute
    if "sensitivity" in options.get("outputs", ()):
        pairs["sensitivity"] = image.sensitivity, truth.sensitivity
    for name, (value, true_value) in pairs.items():
        errors[name] = relative_error(value, true_value) if value.isfinite().all() else float("inf")
    return image, gradients, errors


def assert_matches_reference(
    gaussians: Gaussians, cam: Camera, value_tolerance: float = 2e-6, gradient_tolerance: float = 5e-6, **options: Any
) -> tuple[Rendering, dict[str, Tensor]]:
    """The native back end agrees with the reference in every map and every gradient, or the assertion names which."""
    image, gradients, errors = errors_against_reference(gaussians, cam, **options)
    for name, error in errors.items():
        assert error < (value_tolerance if name == "maps" else gradient_tolerance), f"{name}: error {error:.2g}"
    return image, gradients

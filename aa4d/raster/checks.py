"""Refusing what cannot be drawn, in one sentence that names the tensor."""

from __future__ import annotations

import math
from numbers import Integral

import torch
from torch import Tensor

from aa4d.raster.constants import MAX_FEATURES, MAX_SIDE
from aa4d.raster.types import Camera, Gaussians

RIGID_TOLERANCE = 1e-3


def check_shapes(gaussians: Gaussians, camera: Camera, background: Tensor) -> None:
    """Raises ValueError where a shape, a kind of tensor, or the image's size, is wrong; TypeError for no tensor."""
    for name, value in {**vars(gaussians), "viewmat": camera.viewmat, "K": camera.K, "background": background}.items():
        if not isinstance(value, Tensor) and (name != "features" or value is not None):
            raise TypeError(f"{name} is a {type(value).__name__}, expected a torch tensor")
    count = len(gaussians.means) if gaussians.means.dim() else 0
    expected: list[tuple[str, Tensor, tuple[int, ...]]] = [
        ("means", gaussians.means, (count, 3)),
        ("quaternions", gaussians.quaternions, (count, 4)),
        ("scales", gaussians.scales, (count, 3)),
        ("opacities", gaussians.opacities, (count,)),
        ("colors", gaussians.colors, (count, 3)),
        ("viewmat", camera.viewmat, (4, 4)),
        ("K", camera.K, (3, 3)),
        ("background", background, (3,)),
    ]
    for name, tensor, shape in expected:
        if tensor.shape != shape:
            raise ValueError(f"{name} has shape {list(tensor.shape)}, expected {list(shape)}")
        _check_kind(name, tensor)
    features = gaussians.features
    if features is not None and (features.dim() != 2 or len(features) != count or features.shape[1] > MAX_FEATURES):
        raise ValueError(f"features has shape {list(features.shape)}, expected [{count}, at most {MAX_FEATURES}]")
    if features is not None:
        _check_kind("features", features)
    for name, side in (("width", camera.width), ("height", camera.height)):
        if not isinstance(side, Integral):
            raise TypeError(f"{name} is {side!r}, expected a whole number")
    if not (1 <= camera.width <= MAX_SIDE and 1 <= camera.height <= MAX_SIDE):
        raise ValueError(
            f"the image has {camera.width} x {camera.height} pixels, expected 1 to {MAX_SIDE} along each side"
        )


def check_camera(camera: Camera, background: Tensor) -> None:
    """Raises ValueError where the camera or the background holds no usable numbers."""
    viewmat, K, background = _on_cpu(camera.viewmat, camera.K, background)
    for name, tensor in (("viewmat", viewmat), ("K", K), ("background", background)):
        _check_finite(name, tensor)
    (fx, skew, _), (below, fy, _), _ = K.tolist()
    if fx <= 0 or fy <= 0 or skew or below:
        raise ValueError(f"K has focal lengths {fx}, {fy} and skew {skew or below}, expected positive ones and no skew")
    if K[2].tolist() != [0, 0, 1]:
        raise ValueError(f"K ends in the row {K[2].tolist()}, expected 0, 0, 1")
    if not _is_rigid(viewmat):
        raise ValueError("viewmat is not a rotation and a translation (it mirrors, scales or shears)")
    if not 0 < camera.near < math.inf:
        raise ValueError(f"near is {camera.near}, expected more than 0 and finite")


def _on_cpu(*tensors: Tensor) -> list[Tensor]:
    """Without history, in float64, and fetched from a device at once: each wait for it would idle both."""
    if len({tensor.device for tensor in tensors}) > 1:
        return [tensor.detach().double().cpu() for tensor in tensors]
    values = torch.cat([tensor.detach().double().flatten() for tensor in tensors]).cpu()
    parts = values.split([tensor.numel() for tensor in tensors])
    return [part.view(tensor.shape) for part, tensor in zip(parts, tensors, strict=True)]


def _is_rigid(matrix: Tensor) -> bool:
    """Of a float64 pose on the CPU, up to what float32 and the small steps of learned poses leave."""
    rotation = matrix[:3, :3]
    is_orthogonal = (rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max() < RIGID_TOLERANCE
    return bool(is_orthogonal and torch.linalg.det(rotation) > 0) and matrix[3].tolist() == [0, 0, 0, 1]


def check_gaussians(gaussians: Gaussians) -> None:
    """Raises ValueError at the first NaN or infinity."""
    tensors = {name: tensor.detach() for name, tensor in vars(gaussians).items() if tensor is not None}
    if torch.stack([tensor.isfinite().all() for tensor in tensors.values()]).all():  # one wait for a device, not six
        return
    for name, tensor in tensors.items():
        _check_finite(name, tensor)


def finite(gaussians: Gaussians) -> Tensor:
    """[N] whether everything about a Gaussian is finite."""
    result = torch.isfinite(gaussians.opacities)
    for tensor in vars(gaussians).values():
        if tensor is not None and tensor.dim() == 2:
            result = result & torch.isfinite(tensor).all(dim=-1)
    return result


def _check_kind(name: str, tensor: Tensor) -> None:
    if not tensor.is_floating_point():  # colours in bytes, above all, would be drawn 255 times too bright
        raise ValueError(f"{name} is of {tensor.dtype}, expected floating point")
    if tensor.layout != torch.strided or tensor.is_meta:
        raise ValueError(f"{name} holds no plain array ({tensor.layout} on {tensor.device}), expected a dense tensor")


def _check_finite(name: str, tensor: Tensor) -> None:
    bad = ~torch.isfinite(tensor.detach())
    if bad.any():
        first = tuple(bad.nonzero()[0].tolist())
        place = ", ".join(str(index) for index in first)
        raise ValueError(f"{name}[{place}] is {tensor[first].item()}, expected a finite number")

"""The readable rasteriser: plain torch, any dtype, gradients by autograd. The native one is held to it.

EWA splatting (Zwicker et al. 2002) as in 3D Gaussian Splatting (Kerbl et al. 2023, section 4 and appendix A), with the
constants of gsplat.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import normalize

from aa4d.raster.constants import (
    DILATION,
    FRUSTUM_MARGIN,
    MAX_ALPHA,
    MIN_ALPHA,
    MIN_QUATERNION_NORM,
    MIN_TRANSMITTANCE,
)
from aa4d.raster.types import Camera, Gaussians, Rendering

_TILE = 32  # pixels; bounds the memory and changes nothing else


@dataclass(frozen=True)
class Projected:
    """M visible Gaussians on the screen, near to far."""

    index: Tensor  # [M] which Gaussian
    centers: Tensor  # [M, 2] pixels
    covariances: Tensor  # [M, 2, 2] dilated, px^2
    depths: Tensor  # [M]
    opacities: Tensor  # [M]
    radii: Tensor  # [M] int32, pixels to where alpha falls to the cut-off


def rasterize(gaussians: Gaussians, camera: Camera, background: Tensor, depth: bool) -> Rendering:
    """See `aa4d.raster.rasterize`."""
    count = gaussians.means.shape[0]
    projected = project(gaussians, camera)
    screen_gradient = gaussians.means.new_zeros(count)
    centers = projected.centers
    if centers.requires_grad:
        half = centers.new_tensor([camera.width / 2, camera.height / 2])

        def fill(grad: Tensor) -> None:
            screen_gradient[projected.index] = (grad * half).norm(dim=-1)

        centers.register_hook(fill)
    radii = torch.zeros(count, dtype=torch.int32, device=centers.device)
    radii[projected.index] = projected.radii

    channels = gaussians.colors[projected.index]
    if depth:
        channels = torch.cat([channels, projected.depths[:, None]], dim=-1)
    rows = []
    for top in range(0, camera.height, _TILE):
        row = []
        for left in range(0, camera.width, _TILE):
            bottom, right = min(top + _TILE, camera.height), min(left + _TILE, camera.width)
            y = torch.arange(top, bottom, dtype=centers.dtype, device=centers.device) + 0.5
            x = torch.arange(left, right, dtype=centers.dtype, device=centers.device) + 0.5
            pixels = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)
            near = reaches(projected, left, top, right, bottom)
            weights, transmittance = blend(projected, near, pixels.reshape(-1, 2))
            values = torch.cat([weights @ channels[near], transmittance[:, None]], dim=-1)
            row.append(values.reshape(bottom - top, right - left, -1))
        rows.append(torch.cat(row, dim=1))
    image = torch.cat(rows, dim=0)

    transmittance = image[..., -1]
    alpha = 1 - transmittance
    color = image[..., :3] + transmittance[..., None] * background
    depth_map = None
    if depth:
        covered = alpha > 0
        depth_map = torch.where(covered, image[..., 3] / torch.where(covered, alpha, 1), 0)
    return Rendering(color, alpha, depth_map, radii, screen_gradient)


def project(gaussians: Gaussians, camera: Camera) -> Projected:
    """The Gaussians that reach the image, on the screen.

    The centre goes through the pinhole; the covariance through the projection's Jacobian at the centre, whose x / z and
    y / z are clamped a little outside the image, then gets the low-pass filter's `DILATION`.
    """
    rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
    index = torch.arange(gaussians.means.shape[0], device=gaussians.means.device)
    in_camera = gaussians.means @ rotation.T + translation
    index = index[(in_camera[:, 2] >= camera.near) & (gaussians.opacities >= MIN_ALPHA)]
    index = index[torch.argsort(in_camera[index, 2].detach(), stable=True)]
    x, y, z = in_camera[index].unbind(-1)
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]

    margin_x, margin_y = FRUSTUM_MARGIN * camera.width / 2 / fx, FRUSTUM_MARGIN * camera.height / 2 / fy
    slope_x = torch.clamp(x / z, -(cx / fx + margin_x), (camera.width - cx) / fx + margin_x)
    slope_y = torch.clamp(y / z, -(cy / fy + margin_y), (camera.height - cy) / fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([fx / z, zero, -fx * slope_x / z], -1), torch.stack([zero, fy / z, -fy * slope_y / z], -1)], -2
    )
    shape = jacobian @ rotation @ rotations(gaussians.quaternions[index]) * gaussians.scales[index, None, :]
    covariances = shape @ shape.mT + DILATION * torch.eye(2, dtype=z.dtype, device=z.device)
    centers = torch.stack([fx * x / z + cx, fy * y / z + cy], -1)
    opacities = gaussians.opacities[index]

    with torch.no_grad():
        middle = (covariances[:, 0, 0] + covariances[:, 1, 1]) / 2
        difference = (covariances[:, 0, 0] - covariances[:, 1, 1]) / 2
        largest = middle + torch.hypot(difference, covariances[:, 0, 1])
        radii = torch.ceil(torch.sqrt(2 * torch.log(opacities / MIN_ALPHA) * largest)).clamp(1, 1e9).to(torch.int32)
    projected = Projected(index, centers, covariances, z, opacities, radii)
    seen = reaches(projected, 0, 0, camera.width, camera.height)
    return Projected(*(value[seen] for value in vars(projected).values()))


def rotations(quaternions: Tensor) -> Tensor:
    """[M, 4] w x y z of any length to rotation matrices [M, 3, 3]; a zero quaternion does not rotate."""
    w, x, y, z = normalize(quaternions, dim=-1, eps=MIN_QUATERNION_NORM).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def reaches(projected: Projected, left: int, top: int, right: int, bottom: int) -> Tensor:
    """[M] whether the box around the ellipse alpha = MIN_ALPHA touches a rectangle of pixels."""
    with torch.no_grad():
        reach = torch.sqrt(2 * torch.log(projected.opacities / MIN_ALPHA))
        half = reach[:, None] * projected.covariances.diagonal(dim1=-2, dim2=-1).sqrt()
        low = projected.centers.new_tensor([left, top])
        high = projected.centers.new_tensor([right, bottom])
        return ((projected.centers + half >= low) & (projected.centers - half <= high)).all(dim=-1)


def alphas(projected: Projected, which: Tensor, pixels: Tensor) -> Tensor:
    """[P, m] opacity that each of the Gaussians `which` has at each pixel, before the clamp and the cut-off."""
    (a, b), (_, c) = (row.unbind(-1) for row in projected.covariances[which].unbind(-2))
    dx, dy = (pixels[:, None, :] - projected.centers[which]).unbind(-1)
    # d^T cov^-1 d, completed to squares: no cancellation for a needle.
    along = dx - b / c * dy
    mahalanobis = along**2 / (a - b * b / c) + dy**2 / c
    return projected.opacities[which] * torch.exp(-mahalanobis / 2)


def blend(projected: Projected, which: Tensor, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Weights [P, m] of the Gaussians `which` at each pixel, front to back, and the transmittance left behind [P]."""
    alpha = alphas(projected, which, pixels)
    alpha = torch.where(alpha >= MIN_ALPHA, alpha.clamp(max=MAX_ALPHA), 0)
    # A sum of logarithms: a product over thousands of opaque layers would fall to zero and take its gradient with it.
    layers = torch.log1p(-alpha)
    behind = torch.cumsum(layers, dim=-1)
    adds = behind.detach().exp() > MIN_TRANSMITTANCE
    weights = torch.where(adds, alpha * torch.exp(behind - layers), 0)
    return weights, torch.exp(torch.where(adds, layers, 0).sum(dim=-1))

"""The readable rasteriser: plain torch, any dtype, gradients by autograd. The native one is held to it.

EWA splatting (Zwicker et al. 2002) as in 3D Gaussian Splatting (Kerbl et al. 2023, section 4 and appendix A), with the
constants of gsplat.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import normalize

from aa4d.raster.checks import check_gaussians, finite
from aa4d.raster.constants import DILATION, FRUSTUM_MARGIN, MAX_ALPHA, MIN_COMPENSATION, MIN_QUATERNION_NORM
from aa4d.raster.cutoffs import CUTOFFS, Cutoffs
from aa4d.raster.types import Camera, Gaussians, Options, Output, Rendering

_TILE = 32  # pixels; bounds the memory and changes nothing else


@dataclass(frozen=True)
class Projected:
    """M visible Gaussians on the screen, near to far."""

    index: Tensor  # [M] which Gaussian
    centers: Tensor  # [M, 2] pixels
    covariances: Tensor  # [M, 2, 2] dilated, px^2
    determinants: Tensor  # [M] of the covariances
    depths: Tensor  # [M]
    opacities: Tensor  # [M] compensated in the antialiased mode
    reaches: Tensor  # [M] d^T covariance^-1 d at which alpha falls to the cut-off

    def only(self, which: Tensor) -> Projected:
        return Projected(**{name: value[which] for name, value in vars(self).items()})


class ScreenGradient:
    """Collects gradients on the screen while autograd walks back: see `Rendering`."""

    def __init__(self, camera: Camera, projected: Projected, count: int, outputs: Collection[Output]) -> None:
        self.norm = projected.centers.new_zeros(count)
        self.absolute_norm = projected.centers.new_zeros(count) if "absolute_gradient" in outputs else None
        self.sensitivity = projected.centers.new_zeros(count) if "sensitivity" in outputs else None
        self._half = projected.centers.new_tensor([camera.width / 2, camera.height / 2])
        self._index = projected.index
        self._absolute = projected.centers.new_zeros(count, 2)
        self._squared = projected.centers.new_zeros(count)
        if projected.centers.requires_grad:
            projected.centers.register_hook(self._take_sum)
        if projected.opacities.requires_grad:
            projected.opacities.register_hook(self._take_squares)

    def watch(self, index: Tensor, centers: Tensor) -> None:
        """Follow the gradient of [P, m, 2], the centres as each pixel sees them."""
        if self.absolute_norm is not None and centers.requires_grad:
            centers.register_hook(lambda grad: self._take_pixels(index, grad))

    def watch_alpha(self, projected: Projected, alpha: Tensor) -> None:
        """Follow the gradient of alpha [P, m], zero where nothing is added."""
        if self.sensitivity is None or not alpha.requires_grad:
            return
        opacity, added = projected.opacities.detach(), alpha.detach() > 0

        def take(grad: Tensor) -> None:
            self._squared[projected.index] += torch.where(added, opacity * grad, 0).square().sum(dim=0)

        alpha.register_hook(take)

    def _take_pixels(self, index: Tensor, grad: Tensor) -> None:
        self._absolute[index] += grad.abs().sum(dim=0)

    def _take_sum(self, grad: Tensor) -> None:
        self.norm[self._index] = (grad * self._half).norm(dim=-1)
        if self.absolute_norm is not None:
            self.absolute_norm.copy_((self._absolute * self._half).norm(dim=-1))
            self._absolute.zero_()

    def _take_squares(self, _grad: Tensor) -> None:
        if self.sensitivity is not None:
            self.sensitivity.copy_(self._squared)
            self._squared.zero_()


def rasterize(
    gaussians: Gaussians, camera: Camera, background: Tensor, options: Options, cutoffs: Cutoffs | None = None
) -> Rendering:
    """See `aa4d.raster.rasterize`; `cutoffs` replaces those of `options.precision`."""
    if not options.mask_invalid:
        check_gaussians(gaussians)
    cutoffs = cutoffs or CUTOFFS[options.precision]
    projected = project(gaussians, camera, options.mode == "antialiased", cutoffs)
    count = len(gaussians.means)
    screen = ScreenGradient(camera, projected, count, options.outputs)

    # Everything that is blended, in one tensor: colour, weight, depth, features.
    colors, features = gaussians.colors[projected.index], gaussians.features
    channels = [colors, torch.ones_like(colors[:, :1]), projected.depths[:, None]]
    if features is not None:
        channels.append(features[projected.index])
    values = torch.cat(channels, dim=-1)
    rows = []
    for top in range(0, camera.height, _TILE):
        bottom = min(top + _TILE, camera.height)
        row = []
        for left in range(0, camera.width, _TILE):
            right = min(left + _TILE, camera.width)
            y = torch.arange(top, bottom, dtype=values.dtype, device=values.device) + 0.5
            x = torch.arange(left, right, dtype=values.dtype, device=values.device) + 0.5
            pixels = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1).reshape(-1, 2)
            near = touches(projected, left, top, right, bottom)
            weights, transmittance = blend(projected.only(near), pixels, cutoffs, screen)
            blended = torch.cat([weights @ values[near], transmittance[:, None]], dim=-1)
            row.append(blended.reshape(bottom - top, right - left, -1))
        rows.append(torch.cat(row, dim=1))
    image = torch.cat(rows, dim=0)

    weight, transmittance = image[..., 3], image[..., -1]
    radii = torch.zeros(count, dtype=torch.int32, device=values.device)
    radii[projected.index] = extents(projected)
    return Rendering(
        color=image[..., :3] + transmittance[..., None] * background,
        alpha=1 - transmittance,
        depth=torch.where(weight > 0, image[..., 4] / torch.where(weight > 0, weight, 1), 0)
        if "depth" in options.outputs
        else None,
        radii=radii,
        screen_gradient=screen.norm,
        screen_gradient_absolute=screen.absolute_norm,
        sensitivity=screen.sensitivity,
        features=None if features is None else image[..., 5:-1],
    )


def project(gaussians: Gaussians, camera: Camera, antialiased: bool, cutoffs: Cutoffs) -> Projected:
    """The Gaussians that reach the image, on the screen; those that are not finite are left out.

    The centre goes through the pinhole; the covariance through the projection's Jacobian at the centre, whose x / z and
    y / z are clamped a little outside the image, then gets the low-pass filter's `DILATION`.
    """
    rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
    rotation, translation = rotation.to(gaussians.means), translation.to(gaussians.means)
    index = finite(gaussians).nonzero()[:, 0]  # before anything is computed: zero times NaN would spoil the gradients
    in_camera = gaussians.means[index] @ rotation.T + translation
    order = torch.argsort(in_camera[:, 2].detach(), stable=True)
    order = order[in_camera[order, 2] >= camera.near]
    index, (x, y, z) = index[order], in_camera[order].unbind(-1)
    K = camera.K.to(gaussians.means)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]

    margin_x, margin_y = FRUSTUM_MARGIN * camera.width / 2 / fx, FRUSTUM_MARGIN * camera.height / 2 / fy
    slope_x = torch.clamp(x / z, -(cx / fx + margin_x), (camera.width - cx) / fx + margin_x)
    slope_y = torch.clamp(y / z, -(cy / fy + margin_y), (camera.height - cy) / fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([fx / z, zero, -fx * slope_x / z], -1), torch.stack([zero, fy / z, -fy * slope_y / z], -1)], -2
    )
    # The covariance's square root, [M, 2, 3]. Determinants come from its rows: a c - b^2 of a needle would cancel.
    root = jacobian @ rotation @ rotations(gaussians.quaternions[index]) * gaussians.scales[index, None, :]
    undilated = root @ root.mT
    covariances = undilated + DILATION * torch.eye(2, dtype=z.dtype, device=z.device)
    undilated_determinants = torch.linalg.cross(root[:, 0], root[:, 1]).square().sum(dim=-1)
    trace = undilated.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
    determinants = undilated_determinants + DILATION * trace + DILATION**2

    opacities = gaussians.opacities[index]
    if antialiased:
        # Mip-Splatting (Yu et al. 2024, equation 10): the dilation must not add opacity.
        ratio = undilated_determinants / determinants
        opacities = opacities * torch.sqrt(ratio.clamp(min=MIN_COMPENSATION**2))
    projected = Projected(
        index=index,
        centers=torch.stack([fx * x / z + cx, fy * y / z + cy], -1),
        covariances=covariances,
        determinants=determinants,
        depths=z,
        opacities=opacities,
        reaches=2 * torch.log(opacities.detach() / cutoffs.alpha),
    )
    projected = projected.only(projected.reaches >= 0)
    return projected.only(touches(projected, 0, 0, camera.width, camera.height))


def rotations(quaternions: Tensor) -> Tensor:
    """[M, 4] w x y z of any length to rotation matrices [M, 3, 3]; a zero quaternion does not rotate."""
    w, x, y, z = normalize(quaternions, dim=-1, eps=MIN_QUATERNION_NORM).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def mahalanobis(projected: Projected, dx: Tensor, dy: Tensor) -> Tensor:
    """d^T covariance^-1 d of offsets [..., M] from the centres, completed to squares: a needle cancels nothing."""
    b, c = projected.covariances[:, 0, 1], projected.covariances[:, 1, 1]
    return (dx - b / c * dy).square() * c / projected.determinants + dy.square() / c


def touches(projected: Projected, left: int, top: int, right: int, bottom: int) -> Tensor:
    """[M] whether the ellipse alpha = cut-off comes near the pixel centres of a rectangle.

    The point of the rectangle that is nearest in the ellipse's measure lies on a side that faces the centre: on the
    vertical one, at the best y for its x, or on the horizontal one, at the best x for its y.
    """
    slack = 0.01  # px: rounding must not lose a pixel
    with torch.no_grad():
        x, y = projected.centers.unbind(-1)
        x_low, x_high, y_low, y_high = left + 0.5 - x, right - 0.5 - x, top + 0.5 - y, bottom - 0.5 - y
        x_low, x_high, y_low, y_high = x_low - slack, x_high + slack, y_low - slack, y_high + slack
        x_side = torch.zeros_like(x).clamp(x_low, x_high)
        y_side = torch.zeros_like(y).clamp(y_low, y_high)
        a, b, c = projected.covariances[:, 0, 0], projected.covariances[:, 0, 1], projected.covariances[:, 1, 1]
        vertical = mahalanobis(projected, x_side, (b / a * x_side).clamp(y_low, y_high))
        horizontal = mahalanobis(projected, (b / c * y_side).clamp(x_low, x_high), y_side)
        return torch.minimum(vertical, horizontal) <= projected.reaches


def extents(projected: Projected) -> Tensor:
    """[M] int32 pixels from the centre to the farthest point of the ellipse alpha = cut-off."""
    with torch.no_grad():
        a, b, c = projected.covariances[:, 0, 0], projected.covariances[:, 0, 1], projected.covariances[:, 1, 1]
        largest = (a + c) / 2 + torch.hypot((a - c) / 2, b)
        return torch.ceil(torch.sqrt(projected.reaches * largest).clamp(max=1e9)).to(torch.int32)


def blend(
    projected: Projected, pixels: Tensor, cutoffs: Cutoffs, screen: ScreenGradient | None = None
) -> tuple[Tensor, Tensor]:
    """Weights [P, M] of Gaussians, near to far, at pixels [P, 2], and the transmittance left behind them [P]."""
    centers = projected.centers.expand(len(pixels), -1, -1)
    if screen is not None:
        screen.watch(projected.index, centers)
    dx, dy = (pixels[:, None, :] - centers).unbind(-1)
    alpha = projected.opacities * torch.exp(-mahalanobis(projected, dx, dy) / 2)
    alpha = torch.where(alpha >= cutoffs.alpha, alpha.clamp(max=MAX_ALPHA), 0)
    if screen is not None:
        screen.watch_alpha(projected, alpha)
    # A sum of logarithms: a product over thousands of opaque layers would fall to zero and take its gradient with it.
    layers = torch.log1p(-alpha)
    behind = torch.cumsum(layers, dim=-1)
    adds = behind.detach().exp() > cutoffs.transmittance
    weights = torch.where(adds, alpha * torch.exp(behind - layers), 0)
    return weights, torch.exp(torch.where(adds, layers, 0).sum(dim=-1))

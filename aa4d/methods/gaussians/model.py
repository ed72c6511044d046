"""Free Gaussians as units: each is drawn as one Gaussian, where a method's deformation puts it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from aa4d.anchors.canonical import spacing
from aa4d.methods.contract import Beginning
from aa4d.methods.gaussians.harmonics import LARGEST_DEGREE, colors_of, constant_of, count_of
from aa4d.methods.scene_model import SceneModel
from aa4d.raster.types import Camera, Gaussians

INITIAL_OPACITY = 0.1
SMALLEST_SCALE = 1e-9


@dataclass(frozen=True)
class GaussianRows:
    """What N free Gaussians own."""

    position: Tensor  # [N, 3] model frame
    log_scale: Tensor  # [N, 3]
    quaternion: Tensor  # [N, 4] w x y z, of any length
    opacity: Tensor  # [N] logit
    sh_constant: Tensor  # [N, 1, 3]
    sh_rest: Tensor  # [N, 15, 3]


class FreeGaussians(nn.Module):
    """The rows as parameters."""

    def __init__(self, rows: GaussianRows) -> None:
        super().__init__()
        for field in fields(rows):
            self.register_parameter(field.name, nn.Parameter(getattr(rows, field.name)))

    def rows(self, index: Tensor | None = None) -> GaussianRows:
        """All of them, or those at `index` [M]."""
        owned = (getattr(self, field.name) for field in fields(GaussianRows))
        return GaussianRows(*(v if index is None else v.index_select(0, index) for v in owned))


class GaussianModel(SceneModel):
    """N free Gaussians; what their deformation is, the method says."""

    per_unit = 1
    degree: Tensor  # of the harmonics in use; it rises while training goes on

    def __init__(self, rows: GaussianRows) -> None:
        super().__init__()
        self.free = FreeGaussians(rows)
        self.register_buffer("degree", torch.zeros((), dtype=torch.int64))

    @abstractmethod
    def deformed(self, rows: GaussianRows, t: float, index: Tensor | None = None) -> GaussianRows:
        """The same Gaussians, those at `index` [M] or all, at t in [0, 1]."""

    def __len__(self) -> int:
        return len(self.free.rows().position)

    def unit_tensors(self) -> tuple[str, ...]:
        return tuple(f"free.{field.name}" for field in fields(GaussianRows))

    def row_groups(self) -> dict[str, list[nn.Parameter]]:
        """One group of parameters for each thing that a Gaussian owns."""
        return {name: [parameter] for name, parameter in self.free.named_parameters()}

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        rows = self.free.rows(visible)
        if t is not None:
            rows = self.deformed(rows, t, visible)
        eye = -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
        coefficients = torch.cat([rows.sh_constant, rows.sh_rest], dim=1)
        direction = F.normalize(rows.position - eye, dim=1)
        return Gaussians(
            means=rows.position,
            quaternions=rows.quaternion,
            scales=rows.log_scale.exp(),
            opacities=rows.opacity.sigmoid(),
            colors=colors_of(coefficients, direction, int(self.degree)),
        )

    def resting(self, t: float | None) -> Tensor:  # noqa: ARG002, what deforms is not asked
        return self.free.rows().position.detach()

    def centers(self, t: float | None) -> Tensor:
        rows = self.free.rows()
        return rows.position if t is None else self.deformed(rows, t).position


def changed(rows: GaussianRows, position: Tensor, turn: Tensor, growth: Tensor) -> GaussianRows:
    """The same at other places [N, 3], with D3DGS's changes [N, 4] of unit quaternions and [N, 3] of scales.

    A scale may become negative, which is the same Gaussian as with the positive one.
    """
    scale = (rows.log_scale.exp() + growth).abs().clamp_min(SMALLEST_SCALE)
    return replace(
        rows, position=position, quaternion=F.normalize(rows.quaternion, dim=1) + turn, log_scale=scale.log()
    )


def initial_rows(beginning: Beginning, voxel: float) -> GaussianRows:
    """One Gaussian for each occupied voxel of edge `voxel` (model units): its points' mean place and color."""
    cells, inverse = np.unique(np.round(beginning.points / voxel), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    count = np.bincount(inverse, minlength=len(cells))[:, None]
    place, color = np.zeros((len(cells), 3)), np.zeros((len(cells), 3))
    np.add.at(place, inverse, beginning.points)
    np.add.at(color, inverse, beginning.colors / 255)
    place, color = place / count, color / count
    n = len(place)
    quaternion = torch.zeros(n, 4)
    quaternion[:, 0] = 1
    scale = spacing(place, floor=1e-3 * voxel)
    return GaussianRows(
        position=torch.from_numpy(place).float(),
        log_scale=torch.from_numpy(np.log(scale)).float()[:, None].repeat(1, 3),
        quaternion=quaternion,
        opacity=torch.full((n,), float(np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)))),
        sh_constant=constant_of(torch.from_numpy(color).float())[:, None],
        sh_rest=torch.zeros(n, count_of(LARGEST_DEGREE) - 1, 3),
    )


def blank_rows(n: int) -> GaussianRows:
    """Of the right shapes, to load a state into."""
    rest = count_of(LARGEST_DEGREE) - 1
    shapes = ((n, 3), (n, 3), (n, 4), (n,), (n, 1, 3), (n, rest, 3))
    return GaussianRows(*(torch.zeros(shape) for shape in shapes))

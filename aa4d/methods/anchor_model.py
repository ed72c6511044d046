"""Anchors with a decoder (Scaffold-GS), which may ride on rigid groups; how they deform is each method's own."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import fields

import numpy as np
import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import AnchorRows, Anchors, spacing, voxel_centres
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.kernels.image_loss import image_loss
from aa4d.methods.contract import Beginning
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.motion.groups import Groups, carry
from aa4d.raster.types import Camera, Gaussians


class AnchorModel(SceneModel):
    """N anchors of K Gaussians each. A method adds `deformed` and the parameter groups."""

    anchors: Anchors
    decoder: Decoder

    def __init__(self, anchors: Anchors, decoder: Decoder) -> None:
        super().__init__()
        self.anchors = anchors
        self.decoder = decoder
        self.per_unit = anchors.offset.shape[1]

    @abstractmethod
    def deformed(self, a: AnchorRows, t: float) -> AnchorState:
        """A_i(t) for one t in [0, 1]; of an anchor that rides, in its group's frame."""

    def __len__(self) -> int:
        return len(self.anchors)

    def unit_tensors(self) -> tuple[str, ...]:
        owned = (field.name for field in fields(AnchorRows))
        return tuple(f"anchors.{name}" for name in owned if getattr(self.anchors, name) is not None)

    def static_groups(self) -> dict[str, list[nn.Parameter]]:
        """Parameters, by the names of their rates, of anchors that do not deform, and of their decoder."""
        return {
            "offset": [self.anchors.offset],
            "feature": [self.anchors.feature],
            "log_scale": [self.anchors.log_scale],
            "decoder_opacity": list(self.decoder.opacity.parameters()),
            "decoder_color": list(self.decoder.color.parameters()),
            "decoder_covariance": list(self.decoder.covariance.parameters()),
        }

    @property
    def group(self) -> Tensor | None:
        return self.anchors.group

    def ride(self, groups: Groups, group: Tensor) -> None:
        """Let anchors ride on rigid groups from now on: group [N], -1 for those that belong to the world."""
        self.groups = groups
        self.anchors.group = group

    def canonical(self, a: AnchorRows) -> AnchorState:
        """A_i as the coarse stage has it."""
        return AnchorState(a.position, a.feature, a.offset, a.log_scale.exp())

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        """What the anchors (those at `visible` [M], if given) look like to a camera at time t, K Gaussians each.

        At t = None the canonical scene: the coarse stage.
        """
        a = self.anchors.rows(visible)
        state = self.canonical(a) if t is None else self.deformed(a, t)
        eye = camera_center(camera)
        if self.groups is None or a.group is None:
            return self.decoder(state, eye)
        rows = (a.group >= 0).nonzero()[:, 0]
        group = a.group[rows]
        pose = self.groups.pose(t).at(group)
        eyes = eye.expand_as(a.position).index_copy(0, rows, pose.to_group(eye.expand(len(rows), 1, 3))[:, 0])
        gaussians = self.decoder(state, eyes)
        return carry(gaussians, len(a.position), rows, pose, self.groups.presence(t)[group])

    def resting(self, t: float | None) -> Tensor:
        """[N, 3] where the anchors are at t but for the field's deformation, model frame."""
        return self._in_world(self.anchors.position, self.anchors.group, t)

    def centers(self, t: float | None) -> Tensor:
        """[N, 3] x_i(t): where the anchors are at t, model frame."""
        if t is None:
            return self.resting(None)
        return self._in_world(self.deformed(self.anchors.rows(), t).position, self.anchors.group, t)

    def _in_world(self, position: Tensor, group: Tensor | None, t: float | None) -> Tensor:
        """Positions [N, 3] of anchors, in the frame of the groups [N] that they belong to, in the model's frame."""
        if self.groups is None or group is None:
            return position
        rows = (group >= 0).nonzero()[:, 0]
        pose = self.groups.pose(t).at(group[rows])
        return position.index_copy(0, rows, pose.to_world(position.index_select(0, rows)[:, None])[:, 0])


def camera_center(camera: Camera) -> Tensor:
    """-R^T T, [3]."""
    return -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]


def initial_places(beginning: Beginning, voxel: float) -> tuple[Tensor, Tensor]:
    """One anchor for each occupied voxel of edge `voxel` (model units): its centre [N, 3] and log spacing [N, 6]."""
    centers = voxel_centres(beginning.points, voxel)
    scale = spacing(centers, floor=1e-3 * voxel)
    return torch.from_numpy(centers).float(), torch.from_numpy(np.log(scale)).float()[:, None].repeat(1, 6)


def loss_with_volume(rendered: Rendered, target: Tensor, dssim: float, volume: float) -> tuple[Tensor, Tensor]:
    """Scaffold-GS's loss of an image: L1, D-SSIM, and the drawn Gaussians' mean volume; and the mean squared error."""
    loss, squared_error = image_loss(rendered.rendering.color, target, dssim)
    drawn = (rendered.rendering.radii > 0).float()
    x, y, z = rendered.gaussians.scales.unbind(1)  # the gradient of prod() takes ten times as long
    mean = (x * y * z * drawn).sum() / drawn.sum().clamp_min(1)
    return loss + volume * mean, squared_error

"""Rigid groups: anchors that belong to a mover live in its frame and ride on its trajectory.

The pose of group g at time t is a turn by psi_g(t) about `up` and a shift to p_g(t), both a uniform cubic B-spline of
learned control points (aa4d/motion/spline.py). This goes beyond the paper, whose field keeps what is left: an anchor's
own deformation happens in its group's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from aa4d.motion.spline import weights_at
from aa4d.raster.types import Gaussians

SHORTEST_RAMP = 1e-9  # of t


@dataclass(frozen=True)
class Pose:
    """Where groups are: x_world = rotation x_group + position, all in the model's frame."""

    position: Tensor  # [G, 3]
    rotation: Tensor  # [G, 3, 3]
    quaternion: Tensor  # [G, 4, 4] the matrix that multiplies quaternions w x y z by the rotation's from the left

    def at(self, group: Tensor) -> Pose:
        """Of the groups at `group` [M]."""
        return Pose(*(value.index_select(0, group) for value in (self.position, self.rotation, self.quaternion)))

    def to_world(self, x: Tensor) -> Tensor:
        """[G, K, 3], K points a group."""
        return torch.baddbmm(self.position[:, None], x, self.rotation.transpose(1, 2))

    def to_group(self, x: Tensor) -> Tensor:
        """The inverse of `to_world`."""
        return torch.bmm(x - self.position[:, None], self.rotation)

    def turn(self, quaternions: Tensor) -> Tensor:
        """Rotations w x y z of any length, [G, K, 4] in the group's axes, in the world's."""
        return torch.bmm(quaternions, self.quaternion.transpose(1, 2))


def pose_of(position: Tensor, heading: Tensor, up: Tensor) -> Pose:
    """position [G, 3], heading [G] in radians about `up` [3], a unit vector (Rodrigues' formula)."""
    zero = torch.zeros_like(up[0])
    x, y, z = up.unbind()
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).view(3, 3)
    angle = heading[:, None, None]
    rotation = torch.eye(3).to(up) + angle.sin() * cross + (1 - angle.cos()) * (cross @ cross)
    by_up = torch.stack([zero, -x, -y, -z, x, zero, -z, y, y, z, zero, -x, z, -y, x, zero]).view(4, 4)
    return Pose(position, rotation, (angle / 2).cos() * torch.eye(4).to(up) + (angle / 2).sin() * by_up)


class Groups(nn.Module):
    """Trajectories of G rigid groups."""

    start: Tensor  # [G, C, 4] the control points that learning began with
    reference: Tensor  # [G, 4] the pose at which a group's anchors are looked up in the field; fixed
    shown: Tensor  # [G, 4] as in aa4d/motion/tracks.py
    up: Tensor  # [3]

    def __init__(self, names: tuple[str, ...], control: Tensor, reference: Tensor, shown: Tensor, up: Tensor) -> None:
        """control: [G, C, 4] position in model units, heading in radians; `names` [G] for people."""
        super().__init__()
        self.names = names
        self.position = nn.Parameter(control[..., :3].clone())  # [G, C, 3]
        self.heading = nn.Parameter(control[..., 3].clone())  # [G, C]
        self.register_buffer("start", control.clone())
        self.register_buffer("reference", reference)
        self.register_buffer("shown", shown)
        self.register_buffer("up", up)

    def __len__(self) -> int:
        return len(self.reference)

    def pose(self, t: float | None) -> Pose:
        """Of every group at t in [0, 1], or at its reference where t is None."""
        if t is None:
            return pose_of(self.reference[:, :3], self.reference[:, 3], self.up)
        first, weights = weights_at(t, self.position.shape[1])
        w = torch.tensor(weights, dtype=self.position.dtype, device=self.position.device)
        position = (w[:, None] * self.position[:, first : first + 4]).sum(1)
        return pose_of(position, (w * self.heading[:, first : first + 4]).sum(1), self.up)

    def presence(self, t: float | None) -> Tensor:
        """[G] in [0, 1]: the share of its opacity that each group has at t; one where t is None."""
        if t is None:
            return torch.ones_like(self.shown[:, 0])
        appear, there, until, vanish = self.shown.unbind(1)
        rising = (t - appear) / (there - appear).clamp_min(SHORTEST_RAMP)
        falling = (vanish - t) / (vanish - until).clamp_min(SHORTEST_RAMP)
        return torch.minimum(rising, falling).clamp(0, 1)

    @torch.no_grad()
    def bound(self, distance: float, angle: float) -> None:
        """Take back what learning moved control points by more than `distance` (model units) or `angle` (radians).

        NaN stays NaN, for the watch on what is not finite.
        """
        # Bounded before it is measured: the square of a huge number overflows.
        shift = (self.position - self.start[..., :3]).clamp(-1e6, 1e6)
        share = distance / shift.norm(dim=-1, keepdim=True).clamp_min(distance)
        self.position.copy_(torch.where(share < 1, self.start[..., :3] + share * shift, self.position))
        turn = self.heading - self.start[..., 3]
        self.heading.copy_(self.start[..., 3] + turn.clamp(-angle, angle))


def blank_groups(names: tuple[str, ...], controls: int) -> Groups:
    """Of the right shapes, to load a state into."""
    zeros = torch.zeros(len(names), 4)
    return Groups(names, torch.zeros(len(names), controls, 4), zeros, zeros.clone(), torch.zeros(3))


def carry(gaussians: Gaussians, anchors: int, rows: Tensor, pose: Pose, presence: Tensor) -> Gaussians:
    """Take the Gaussians of grouped anchors from their group's frame to the world.

    Args:
        gaussians: K for each of `anchors` anchors, those of an anchor together.
        rows: [M] the anchors that belong to a group.
        pose, presence: M rows, of the group of each of those.
    """

    def part(value: Tensor) -> Tensor:
        return value.view(anchors, -1, *value.shape[1:]).index_select(0, rows)

    def replaced(value: Tensor, new: Tensor) -> Tensor:
        return value.view(anchors, -1, *value.shape[1:]).index_copy(0, rows, new).view(value.shape)

    return replace(
        gaussians,
        means=replaced(gaussians.means, pose.to_world(part(gaussians.means))),
        quaternions=replaced(gaussians.quaternions, pose.turn(part(gaussians.quaternions))),
        opacities=replaced(gaussians.opacities, part(gaussians.opacities) * presence[:, None]),
    )

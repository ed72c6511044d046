"""GroupFlow: groups of Gaussians, each with a rigid motion from the first frame to each of the training times."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

from aa4d.methods.speede.rotations import best_rotations, matrix_of, turn_of
from aa4d.methods.speede.settings import FlowSettings

# Where all Gaussians are at a time: [N, 3].
Places = Callable[[float], Tensor]
ROWS = 2048  # Gaussians whose distances to all groups are held at once


class GroupFlow(nn.Module):
    """G groups with poses at T times; none before they are found. A state of any G and T can be loaded."""

    time: Tensor  # [T] ascending; before there are groups, those of the training views
    center: nn.Parameter  # [G, 3] about which a group turns, at the first time
    turn: nn.Parameter  # [G, T - 1, 3] rotation vectors, from the first time to each later one
    shift: nn.Parameter  # [G, T - 1, 3] of the center, likewise

    def __init__(self, times: tuple[float, ...] = ()) -> None:
        super().__init__()
        self.register_buffer("time", torch.tensor(times))
        for name, shape in (("center", (0, 3)), ("turn", (0, 0, 3)), ("shift", (0, 0, 3))):
            self.register_parameter(name, nn.Parameter(torch.zeros(shape)))

    def __len__(self) -> int:
        return len(self.center)

    def set(self, center: Tensor, turn: Tensor, shift: Tensor) -> None:
        self.center, self.turn, self.shift = (nn.Parameter(value) for value in (center, turn, shift))

    def _load_from_state_dict(self, state: Mapping[str, Any], prefix: str, *more: Any) -> None:
        """Takes the shapes of the state first."""
        for name, own in (*self.named_parameters(), *self.named_buffers()):
            if (value := state.get(prefix + name)) is not None:
                own.data = own.new_empty(value.shape)
        super()._load_from_state_dict(state, prefix, *more)

    def moved(self, position: Tensor, group: Tensor, t: float) -> Tensor:
        """Where Gaussians of groups [N] are at t that are at position [N, 3] at the first time.

        Between two times the shift is linear and the turn at constant speed; before the first and after the last one
        nothing moves.
        """
        steps = self.time.tolist()
        floor = sum(time < t for time in steps) - 1
        if floor < 0 or len(steps) < 2:
            return position
        floor = min(floor, len(steps) - 2)
        share = min((t - steps[floor]) / (steps[floor + 1] - steps[floor]), 1.0)
        turn, shift = self.turn[:, floor], self.shift[:, floor]
        turn_before = self.turn[:, floor - 1] if floor else torch.zeros_like(turn)
        shift_before = self.shift[:, floor - 1] if floor else torch.zeros_like(shift)
        before = matrix_of(turn_before)
        rotation = before @ matrix_of(share * turn_of(before.mT @ matrix_of(turn)))
        center, moved = self.center[group], (shift_before * (1 - share) + shift * share)[group]
        return (rotation[group] @ (position - center)[..., None])[..., 0] + center + moved


@torch.no_grad()
def find_groups(places: Places, times: tuple[float, ...], settings: FlowSettings) -> tuple[Tensor, Tensor, GroupFlow]:
    """Groups in what Gaussians do.

    Returns:
        Their positions [N, 3] at the first time, their groups [N], and the groups' flow.
    """
    s, times = settings, tuple(sorted(times))
    first = places(times[0])
    seeds = farthest_points(first, min(s.groups, len(first)))
    paths = torch.stack([places(t) for t in evenly(times, s.samples)], dim=1)
    group = nearest_group(paths, paths[seeds])
    held = evenly(times, s.times)
    later = torch.stack([places(t) for t in held[1:]], dim=1) if len(held) > 1 else first.new_zeros(len(first), 0, 3)
    centers, turns, shifts = [], [], []
    for g in range(len(seeds)):
        members = (group == g).nonzero()[:, 0]
        members = members[torch.linspace(0, len(members) - 1, min(len(members), s.members)).long()]
        if not len(members):  # another Gaussian at the seed's very place has its group
            members = seeds[g : g + 1]
        start, end = first[members], later[members]
        centers.append(start.mean(0))
        shifts.append(end.mean(0) - start.mean(0))
        turns.append(vectors_of(best_rotations(start, end)))
    flow = GroupFlow(held).to(first)
    flow.set(torch.stack(centers), torch.stack(turns), torch.stack(shifts))
    return first, group, flow


def evenly(times: tuple[float, ...], most: int) -> tuple[float, ...]:
    """At most so many of them, the first and the last among them."""
    if len(times) <= most:
        return times
    return tuple(times[i] for i in torch.linspace(0, len(times) - 1, most).long().tolist())


def vectors_of(rotations: Tensor) -> Tensor:
    """[T, 3, 3] -> [T, 3], of rotations by any angle."""
    if not len(rotations):
        return rotations.new_zeros(0, 3)
    vectors = Rotation.from_matrix(rotations.detach().cpu().double().numpy()).as_rotvec()
    return torch.from_numpy(vectors).to(rotations)


def farthest_points(points: Tensor, count: int) -> Tensor:
    """[count] indices: the first point, and then always the one that is farthest from those chosen."""
    chosen = [0]
    distance = torch.full_like(points[:, 0], torch.inf)
    for _ in range(count - 1):
        distance = torch.minimum(distance, (points - points[chosen[-1]]).square().sum(1))
        chosen.append(int(distance.argmax()))
    return torch.tensor(chosen, device=points.device)


def nearest_group(paths: Tensor, seeds: Tensor) -> Tensor:
    """[N] the group whose seed's path [G, S, 3] a path [N, S, 3] stays near to, and at one distance from.

    Half the mean of the distance over time, and half its standard deviation.
    """
    groups = []
    for part in paths.split(ROWS):
        distance = torch.stack([torch.cdist(part[:, s], seeds[:, s]) for s in range(paths.shape[1])])
        spread = distance.std(0) if len(distance) > 1 else torch.zeros_like(distance[0])
        groups.append((0.5 * spread + 0.5 * distance.mean(0)).argmin(1))
    return torch.cat(groups)

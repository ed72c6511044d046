"""Grid4D's deformation: features of place and time move Gaussians, as far as features of place alone let them."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from aa4d.methods.gaussians.density import rotated
from aa4d.methods.gaussians.model import GaussianModel, GaussianRows, changed
from aa4d.methods.grid4d.hash_grid import HashGrid, Sizes, level_sizes
from aa4d.methods.grid4d.settings import ModelConfig

# Of the grids of place and time: which axes of the box they have.
PAIRS = ((0, 1), (1, 2), (0, 2))
TIME_SHARE = 0.9  # of the grids' extent, that the clip takes


def grid_sizes(config: ModelConfig) -> tuple[list[Sizes], list[Sizes]]:
    """Vertices of each level: of the grid of place, and of each grid of place and time."""
    c = config
    place = level_sizes((c.place_coarsest,) * 3, (c.place_finest,) * 3, c.place_levels)
    coarsest = (c.time_coarsest, c.time_coarsest, min(c.time_coarsest, c.instants))
    return place, level_sizes(coarsest, (c.time_finest, c.time_finest, c.instants), c.time_levels)


class Grid4D(GaussianModel):
    box: Tensor  # [2, 3] lower and upper corner of what the grids cover, model frame

    def __init__(self, config: ModelConfig, rows: GaussianRows) -> None:
        super().__init__(rows)
        c = self.config = config
        self.iteration = 0  # of the stage; what the penalty draws depends on it
        self.register_buffer("box", torch.tensor([[-1.0] * 3, [1.0] * 3]))
        place, time = grid_sizes(c)
        self.place_grid = HashGrid(place, c.table, c.features)
        self.time_grids = nn.ModuleList(HashGrid(time, c.table, c.features) for _ in PAIRS)
        self.attention = nn.Linear(c.features * c.place_levels, c.width)
        self.dynamics = nn.Linear(c.features * c.time_levels * len(PAIRS), c.width)
        self.layers = nn.ModuleList(nn.Linear(c.width, c.width) for _ in range(c.depth))
        self.head_motion = nn.Linear(c.width, 7)
        self.head_quaternion = nn.Linear(c.width, 4)
        self.head_scale = nn.Linear(c.width, 3)
        if c.still_start:
            for head in (self.head_motion, self.head_quaternion, self.head_scale):
                nn.init.zeros_(head.weight)
                nn.init.zeros_(head.bias)

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.row_groups()
        if not canonical:
            grids = (self.place_grid, *self.time_grids)
            groups["grids"] = [p for grid in grids for p in grid.parameters()]
            owned = {id(p) for parameters in groups.values() for p in parameters}
            groups["deformation"] = [p for p in self.parameters() if id(p) not in owned]
        return groups

    def of_box(self, position: Tensor) -> Tensor:
        """Places [N, 3] as shares of the box."""
        low, high = self.box
        return (position.detach() - low) / (high - low).clamp_min(1e-9)

    def of_time(self, place: Tensor, t: float) -> Tensor:
        """Features [N, 3 L C] of the grids of place and time at places of the box."""
        clip = 0.5 + TIME_SHARE * (t - 0.5)
        columns = [place[:, 0], place[:, 1], place[:, 2], torch.full_like(place[:, 0], clip)]
        asked = [torch.stack([columns[a], columns[b], columns[3]], dim=1) for a, b in PAIRS]
        return torch.cat([grid(x) for grid, x in zip(self.time_grids, asked, strict=True)], dim=1)

    def deformed(self, rows: GaussianRows, t: float, index: Tensor | None = None) -> GaussianRows:  # noqa: ARG002
        place = self.of_box(rows.position)
        attention = 2 * self.attention(self.place_grid(place)).sigmoid() - 1
        h = torch.relu(self.dynamics(self.of_time(place, t))) * attention
        for layer in self.layers:
            h = torch.relu(layer(h))
        motion = self.head_motion(h)
        turn = F.pad(motion[:, :1] + 1, (0, 3)) + F.pad(motion[:, 1:4], (1, 0))
        return changed(
            rows,
            position=rotated(turn, rows.position) + motion[:, 4:],
            turn=self.head_quaternion(h),
            growth=self.head_scale(h),
        )

    def set_box(self, points: Tensor) -> None:
        """The grids cover the points [P, 3] that training begins with."""
        self.box.copy_(torch.stack([points.amin(0), points.amax(0)]))

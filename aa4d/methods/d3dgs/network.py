"""D3DGS's deformation network: eight layers over sines of place and time, which enter once more half way."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from aa4d.field.encoding import encoded
from aa4d.methods.d3dgs.settings import ModelConfig

# Gaussians that go through the layers together: what they leave behind in one layer is near when the next asks for it.
ROWS = 1024


class DeformationNetwork(nn.Module):
    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        c = self.config = config
        self.place_inputs, self.time_inputs = 3 * (1 + 2 * c.place_frequencies), 1 + 2 * c.time_frequencies
        inputs = self.place_inputs + self.time_inputs
        entering = {0: inputs, c.skip + 1: inputs + c.width}
        self.layers = nn.ModuleList(nn.Linear(entering.get(i, c.width), c.width) for i in range(c.depth))
        self.head_position = nn.Linear(c.width, 3)
        self.head_quaternion = nn.Linear(c.width, 4)
        self.head_scale = nn.Linear(c.width, 3)
        if c.still_start:
            for head in (self.head_position, self.head_quaternion, self.head_scale):
                nn.init.zeros_(head.weight)
                nn.init.zeros_(head.bias)

    def forward(self, position: Tensor, t: float) -> tuple[Tensor, Tensor, Tensor]:
        """Changes of position [N, 3], quaternion [N, 4] and scale [N, 3] at t; none of it learns through `position`."""
        time = encoded(position.new_tensor([[t]]), self.config.time_frequencies)[0]
        parts = [self._changes(rows, time) for rows in position.detach().split(ROWS)]
        changes = torch.cat(parts) if parts else position.new_zeros(0, 10)
        return tuple(changes.split([3, 4, 3], dim=1))

    def _changes(self, position: Tensor, time: Tensor) -> Tensor:
        """[N, 10]; time [T], encoded."""
        place = encoded(position, self.config.place_frequencies)
        h = place.new_zeros(len(place), 0)
        for i, layer in enumerate(self.layers):
            assert isinstance(layer, nn.Linear)
            entering = i in (0, self.config.skip + 1)
            h = torch.relu(self._entered(layer, place, time, h) if entering else layer(h))
        heads = (self.head_position, self.head_quaternion, self.head_scale)
        return F.linear(h, torch.cat([head.weight for head in heads]), torch.cat([head.bias for head in heads]))

    def _entered(self, layer: nn.Linear, place: Tensor, time: Tensor, h: Tensor) -> Tensor:
        """A layer of [place, time, h]. Time is the same for all rows: a part of the bias."""
        for_place, for_time, for_h = layer.weight.split([self.place_inputs, self.time_inputs, h.shape[1]], dim=1)
        out = F.linear(place, for_place, layer.bias + for_time @ time)
        return torch.addmm(out, h, for_h.T) if h.shape[1] else out

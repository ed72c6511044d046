"""The one network shape of the paper's small predictors: two linear layers with a ReLU between them."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class TwoLayer(nn.Module):
    """output(relu(hidden(x))), Xavier-uniform weights and torch's own biases, as in 4D-GS.

    Biases matter: with none, the ReLUs that see time would all have their kink at t = 0, and start linear in it. With
    `zero_output` the network starts as the zero function, and its first step changes the output layer alone.
    """

    def __init__(self, inputs: int, hidden: int, outputs: int, *, zero_output: bool = False) -> None:
        super().__init__()
        self.hidden = nn.Linear(inputs, hidden)
        self.output = nn.Linear(hidden, outputs)
        for layer in (self.hidden, self.output):
            nn.init.xavier_uniform_(layer.weight)
        if zero_output:
            nn.init.zeros_(self.output.weight)
            nn.init.zeros_(self.output.bias)

    def forward(self, x: Tensor) -> Tensor:
        return self.output(torch.relu(self.hidden(x)))


def with_time(embedding: Tensor, t: float) -> Tensor:
    """[e_i, t], the input of Phi_w, Phi_o and Phi_s: [N, E] -> [N, E + 1]."""
    return torch.cat([embedding, embedding.new_full((embedding.shape[0], 1), t)], dim=1)

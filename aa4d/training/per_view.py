"""What is learned of each training view beside the scene: its pose, its exposure."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.optim import Adam

from aa4d.methods.settings import Decay
from aa4d.methods.tensors import check_like
from aa4d.training.optimiser import MOMENTS, check_moments


class PerView(nn.Module):
    """One small parameter for each view, with an optimiser of its own.

    An iteration that draws one view leaves the moments of the others alone.
    """

    part: str  # of a checkpoint, in which they are
    name: str  # of the parameters there

    def __init__(self, initial: Tensor, rate: Decay) -> None:
        """initial: [N, ...], a row for each view."""
        super().__init__()
        self.of_views = nn.ParameterList(nn.Parameter(row.clone()) for row in initial)
        self._rate = rate
        self.optimiser = Adam(self.of_views, lr=rate.initial, eps=1e-15)

    def stacked(self) -> Tensor:
        """[N, ...]"""
        return torch.stack([p.detach() for p in self.of_views])

    @torch.no_grad()
    def set_to(self, values: Tensor) -> None:
        """values: [N, ...]"""
        for parameter, value in zip(self.of_views, values, strict=True):
            parameter.copy_(value)

    def step(self, progress: float) -> None:
        """After the loss's backward pass. `progress` in [0, 1], over the whole training."""
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate.at(progress)
        self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)

    def fix_gauge(self) -> None:
        """Take out what the scene could do as well, all views alike; once an epoch."""

    def tensors(self) -> dict[str, Tensor]:
        """Everything that the next step depends on, for a checkpoint."""
        kept = {self.name: self.stacked()}
        for key in MOMENTS:
            blank = torch.zeros(()) if key == "step" else torch.zeros_like(self.of_views[0])
            states = [self.optimiser.state.get(p, {}) for p in self.of_views]
            kept[key] = torch.stack([s.get(key, blank).detach().to(kept[self.name].device) for s in states])
        return kept

    @torch.no_grad()
    def load(self, tensors: dict[str, Tensor]) -> None:
        """Raises KeyError or ValueError where they are not `tensors()` of as many views."""
        for name, blank in self.tensors().items():
            check_like(tensors[name], blank, f"{self.part}.{name}")
        self.set_to(tensors[self.name])
        for i, parameter in enumerate(self.of_views):
            if tensors["step"][i] > 0:
                state = {key: tensors[key][i].clone() for key in MOMENTS}
                check_moments(state, parameter, f"{self.part} {i}")
                self.optimiser.state[parameter] = state | {"step": state["step"].cpu()}

"""D3DGS's model, in which the network may give way to rigid groups."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from aa4d.methods.d3dgs.model import D3DGS
from aa4d.methods.d3dgs.settings import ModelConfig
from aa4d.methods.gaussians.model import GaussianRows
from aa4d.methods.speede.group_flow import GroupFlow, find_groups
from aa4d.methods.speede.settings import FlowSettings


class Speede(D3DGS):
    label: Tensor  # [N] int64, the group of each Gaussian, where there are any
    flow: GroupFlow | None

    def __init__(
        self, config: ModelConfig, rows: GaussianRows, *, grouped: bool, times: tuple[float, ...] = ()
    ) -> None:
        """`grouped`: groups may come, with poses at the training views' `times`."""
        super().__init__(config, rows)
        self.flow = GroupFlow(times) if grouped else None
        if grouped:
            self.register_buffer("label", torch.zeros(len(rows.position), dtype=torch.int64))

    def unit_tensors(self) -> tuple[str, ...]:
        return super().unit_tensors() if self.flow is None else (*super().unit_tensors(), "label")

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        if canonical or not self.flow:
            return super().parameter_groups(canonical=canonical)
        flow = self.flow
        return self.row_groups() | {
            "group_center": [flow.center],
            "group_turn": [flow.turn],
            "group_shift": [flow.shift],
        }

    def deformed(self, rows: GaussianRows, t: float, index: Tensor | None = None) -> GaussianRows:
        """Groups move centers alone, as in SpeeDe3DGS."""
        if not self.flow:
            return super().deformed(rows, t, index)
        group = self.label if index is None else self.label[index]
        return replace(rows, position=self.flow.moved(rows.position, group, t))

    @torch.no_grad()
    def begin_flow(self, settings: FlowSettings) -> None:
        """Let groups move the Gaussians from now on, which then rest where they are at the first training view."""
        assert self.flow is not None
        first, self.label, self.flow = find_groups(self.centers, tuple(self.flow.time.tolist()), settings)
        self.tensor("free.position").copy_(first)

"""D3DGS's deformation: what the network says is added to positions, unit quaternions and scales."""

from __future__ import annotations

from torch import Tensor, nn

from aa4d.methods.d3dgs.network import DeformationNetwork
from aa4d.methods.d3dgs.settings import ModelConfig
from aa4d.methods.gaussians.model import GaussianModel, GaussianRows, changed


class D3DGS(GaussianModel):
    def __init__(self, config: ModelConfig, rows: GaussianRows) -> None:
        super().__init__(rows)
        self.config = config
        self.network = DeformationNetwork(config)

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.row_groups()
        return groups if canonical else groups | {"deformation": list(self.network.parameters())}

    def deformed(self, rows: GaussianRows, t: float, index: Tensor | None = None) -> GaussianRows:  # noqa: ARG002
        shift, turn, growth = self.network(rows.position, t)
        return changed(rows, rows.position + shift, turn, growth)

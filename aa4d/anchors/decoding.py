"""From an anchor's state to its K local Gaussians (paper, section 3, after Scaffold-GS)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.kernels.local_gaussians import local_gaussians
from aa4d.raster.types import Gaussians


@dataclass(frozen=True)
class AnchorState:
    """A_i(t), model frame."""

    position: Tensor  # [N, 3]
    feature: Tensor  # [N, F]
    offset: Tensor  # [N, K, 3]
    scale: Tensor  # [N, 6] positive


class Decoder(nn.Module):
    """Opacity, colour, scale and rotation of the local Gaussians from feature and viewing direction."""

    def __init__(self, feature_dim: int, offsets: int, hidden: int) -> None:
        super().__init__()
        self.opacity = TwoLayer(feature_dim + 3, hidden, offsets)
        self.color = TwoLayer(feature_dim + 3, hidden, 3 * offsets)
        self.covariance = TwoLayer(feature_dim + 3, hidden, 7 * offsets)

    def forward(self, state: AnchorState, camera_center: Tensor) -> Gaussians:
        """N anchors -> N * K Gaussians, those of an anchor together; an opacity of zero means "not drawn".

        Args:
            camera_center: [3] model frame.
        """
        # F.normalize keeps an anchor at the camera's very centre finite: its direction becomes zero.
        direction = F.normalize(state.position - camera_center, dim=1)
        view = torch.cat([state.feature, direction], dim=1)
        decoded = evaluate_together((self.opacity, self.color, self.covariance), view)
        return local_gaussians(state.position, state.offset, state.scale, *decoded)

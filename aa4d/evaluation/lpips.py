"""LPIPS, version 0.1 (Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric").

The three feature stacks are torchvision's AlexNet, SqueezeNet 1.1 and VGG16, defined here layer by layer so that their
weights load without torchvision. Images enter in [-1, 1], as the heads were trained; much of the Gaussian-splatting
literature feeds [0, 1] instead, and its figures are not comparable with these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

Network = str  # a name in `STACKS`

SHIFT = (-0.030, -0.088, -0.188)  # of RGB in [-1, 1]: ImageNet's mean and deviation in that range
SCALE = (0.458, 0.448, 0.450)
EPSILON = 1e-10  # keeps a pixel whose features are all zero finite


@dataclass(frozen=True)
class Stack:
    """A feature network: its layers, the layers whose output is compared, and the smallest image side it takes."""

    layers: Callable[[], nn.Sequential]
    taps: tuple[int, ...]
    smallest: int


class LearnedPerceptualSimilarity:
    """LPIPS by one network. Never trained, never differentiated: it only measures."""

    def __init__(self, network: Network, features: dict[str, Tensor], heads: dict[str, Tensor]) -> None:
        """
        Args:
            features: state of the feature layers, "0.weight" and so on; further entries of torchvision's state
                (classifiers) are ignored, and its prefix "features." is understood.
            heads: state of the linear heads, "lin0.model.1.weight" [1, C, 1, 1] and so on.

        Raises:
            KeyError: a tensor is missing.
            RuntimeError: a tensor has the wrong shape.
        """
        stack = STACKS[network]
        self.smallest = stack.smallest
        self._taps = stack.taps
        self._layers = stack.layers()
        own = {name: _entry(features, name) for name in self._layers.state_dict()}
        self._layers.load_state_dict(own)
        self._layers.eval().requires_grad_(False)
        self._heads = [heads[f"lin{i}.model.1.weight"] for i in range(len(stack.taps))]

    def __call__(self, image: Tensor, target: Tensor) -> float:
        """image, target: [H, W, 3] in [0, 1], at least `smallest` pixels a side; symmetric, 0 for equal images."""
        with torch.no_grad():
            a, b = self._normalised_features(image), self._normalised_features(target)
            distances = [F.conv2d((x - y).square(), head).mean() for x, y, head in zip(a, b, self._heads, strict=True)]
        return float(sum(distances))

    def _normalised_features(self, image: Tensor) -> list[Tensor]:
        """Output of each tap, [1, C, h, w], of unit length at every pixel."""
        x = image.permute(2, 0, 1)[None].float() * 2 - 1
        x = (x - x.new_tensor(SHIFT).view(1, 3, 1, 1)) / x.new_tensor(SCALE).view(1, 3, 1, 1)
        tapped = []
        for index, layer in enumerate(self._layers):
            x = layer(x)
            if index in self._taps:
                tapped.append(x / (x.square().sum(1, keepdim=True).sqrt() + EPSILON))
        return tapped


def _entry(state: dict[str, Tensor], name: str) -> Tensor:
    return state[name] if name in state else state[f"features.{name}"]


class _Fire(nn.Module):
    """SqueezeNet's module: a 1x1 bottleneck, then 1x1 and 3x3 convolutions side by side."""

    def __init__(self, inputs: int, squeezed: int, expanded: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(inputs, squeezed, 1)
        self.expand1x1 = nn.Conv2d(squeezed, expanded, 1)
        self.expand3x3 = nn.Conv2d(squeezed, expanded, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        x = torch.relu(self.squeeze(x))
        return torch.cat([torch.relu(self.expand1x1(x)), torch.relu(self.expand3x3(x))], dim=1)


def _alex() -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(3, 64, 11, stride=4, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
    )


def _squeeze() -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(3, 64, 3, stride=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2, ceil_mode=True),
        _Fire(64, 16, 64),
        _Fire(128, 16, 64),
        nn.MaxPool2d(3, 2, ceil_mode=True),
        _Fire(128, 32, 128),
        _Fire(256, 32, 128),
        nn.MaxPool2d(3, 2, ceil_mode=True),
        _Fire(256, 48, 192),
        _Fire(384, 48, 192),
        _Fire(384, 64, 256),
        _Fire(512, 64, 256),
    )


def _vgg() -> nn.Sequential:
    """VGG16 up to its last convolution; the pooling after it is not compared."""
    layers: list[nn.Module] = []
    inputs = 3
    for block, (width, convolutions) in enumerate(((64, 2), (128, 2), (256, 3), (512, 3), (512, 3))):
        if block:
            layers.append(nn.MaxPool2d(2, 2))
        for _ in range(convolutions):
            layers += [nn.Conv2d(inputs, width, 3, padding=1), nn.ReLU()]
            inputs = width
    return nn.Sequential(*layers)


STACKS: dict[Network, Stack] = {
    "alex": Stack(_alex, (1, 4, 7, 9, 11), smallest=31),
    "squeeze": Stack(_squeeze, (1, 4, 7, 9, 10, 11, 12), smallest=17),
    "vgg": Stack(_vgg, (3, 8, 15, 22, 29), smallest=16),
}

from collections.abc import Sequence

from torch import Tensor

Layers = tuple[Tensor, Tensor, Tensor, Tensor]

def look_up(
    planes: Sequence[Tensor],
    coordinates: Tensor,
    time: float,
    scores: Tensor | None,
    threads: int,
    features: Tensor,
    weights: Tensor | None,
) -> None: ...
def look_up_backward(
    planes: Sequence[Tensor],
    coordinates: Tensor,
    time: float,
    scores: Tensor | None,
    weights: Tensor | None,
    d_features: Tensor,
    threads: int,
    result: Tensor,
    d_planes: Sequence[Tensor],
) -> None: ...
def penalise(
    planes: Sequence[Tensor],
    smoothness: Sequence[float],
    constancy: Sequence[float],
    gradients: Sequence[Tensor | None],
    threads: int,
) -> float: ...
def networks_forward(
    x: Tensor,
    networks: Sequence[Layers],
    time: float | None,
    bfloat16: bool,
    threads: int,
    outputs: Sequence[Tensor],
) -> None: ...
def networks_backward(
    x: Tensor,
    networks: Sequence[Layers],
    time: float | None,
    d_outputs: Sequence[Tensor],
    bfloat16: bool,
    threads: int,
    d_x: Tensor | None,
    gradients: Sequence[Layers],
) -> None: ...
def compare_images(
    image: Tensor, target: Tensor, dssim: float, gradient: Tensor | None, threads: int
) -> tuple[float, float, float]: ...
def local_gaussians(anchors: Sequence[Tensor], threads: int, gaussians: Sequence[Tensor]) -> None: ...
def local_gaussians_backward(
    anchors: Sequence[Tensor],
    threads: int,
    opacities: Tensor,
    colors: Tensor,
    gradient: Sequence[Tensor],
    d_anchors: Sequence[Tensor],
) -> None: ...
def bfloat16_in_hardware() -> bool: ...
def instruction_set() -> str: ...

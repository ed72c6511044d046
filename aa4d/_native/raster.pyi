from torch import Tensor

class Scene:
    def __init__(
        self,
        means: Tensor,
        quaternions: Tensor,
        scales: Tensor,
        opacities: Tensor,
        colors: Tensor,
        features: Tensor | None,
        background: Tensor,
    ) -> None: ...

class PinholeCamera:
    def __init__(self, viewmat: Tensor, K: Tensor, width: int, height: int, near: float) -> None: ...

class Settings:
    def __init__(
        self, min_alpha: float, min_transmittance: float, antialiased: bool, mask_invalid: bool, threads: int
    ) -> None: ...

class Frame:
    def count_pairs(self) -> int: ...

def forward(
    scene: Scene,
    camera: PinholeCamera,
    settings: Settings,
    color: Tensor,
    alpha: Tensor,
    depth: Tensor | None,
    features: Tensor | None,
    radii: Tensor,
) -> Frame | None: ...
def backward(
    frame: Frame,
    scene: Scene,
    threads: int,
    color: Tensor | None,
    alpha: Tensor | None,
    depth: Tensor | None,
    depth_value: Tensor | None,
    features: Tensor | None,
    d_means: Tensor,
    d_quaternions: Tensor,
    d_scales: Tensor,
    d_opacities: Tensor,
    d_colors: Tensor,
    d_background: Tensor,
    screen: Tensor,
    screen_absolute: Tensor | None,
    sensitivity: Tensor | None,
    d_features: Tensor | None,
    d_viewmat: Tensor | None,
) -> None: ...
def arithmetic(backward: bool, pairs: int, threads: int) -> float: ...
def instruction_set() -> str: ...
def constants() -> dict[str, float]: ...

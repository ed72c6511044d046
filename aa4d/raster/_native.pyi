from torch import Tensor

class Frame: ...

def forward(
    means: Tensor,
    quaternions: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmat: Tensor,
    K: Tensor,
    near: float,
    background: Tensor,
    min_alpha: float,
    min_transmittance: float,
    threads: int,
    color: Tensor,
    alpha: Tensor,
    depth: Tensor | None,
    radii: Tensor,
) -> Frame: ...
def backward(
    frame: Frame,
    means: Tensor,
    quaternions: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    background: Tensor,
    min_alpha: float,
    min_transmittance: float,
    threads: int,
    color_gradient: Tensor | None,
    alpha_gradient: Tensor | None,
    depth_gradient: Tensor | None,
    depth: Tensor | None,
    d_means: Tensor,
    d_quaternions: Tensor,
    d_scales: Tensor,
    d_opacities: Tensor,
    d_colors: Tensor,
    d_background: Tensor,
    screen_gradient: Tensor,
) -> None: ...
def instruction_set() -> str: ...
def constants() -> dict[str, float]: ...

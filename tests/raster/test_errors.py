"""What cannot be drawn is refused in one sentence; what may be left out is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from raster_scenes import camera, draw, random_gaussians

from aa4d.raster import Gaussians, rasterize

BACKENDS = ["native", "reference"]
NAMES = ["means", "quaternions", "scales", "opacities", "colors", "features"]


def spoiled(name: str, value: float) -> Gaussians:
    """2000 Gaussians (more than one chunk of the projection), of which number 1500 holds `value` in its last place."""
    gaussians = random_gaussians(2000, features=2)
    tensor = getattr(gaussians, name).clone()
    tensor[1500].view(-1)[-1] = value
    return replace(gaussians, **{name: tensor})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("name", NAMES)
def test_non_finite_gaussian_is_refused_by_name_and_index(backend: str, name: str, value: float) -> None:
    place = {"opacities": "1500", "quaternions": "1500, 3", "features": "1500, 1"}.get(name, "1500, 2")
    with pytest.raises(ValueError, match=rf"^{name}\[{place}\] is {value}, expected a finite number$"):
        rasterize(spoiled(name, value), camera(), background=torch.zeros(3), backend=backend)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NAMES)
def test_non_finite_gaussian_is_left_out_on_demand(backend: str, name: str) -> None:
    gaussians = spoiled(name, float("nan"))
    rest = Gaussians(*(torch.cat([value[:1500], value[1501:]]) for value in vars(gaussians).values()))
    small = camera(16, 12, 14)
    image, gradients = draw(gaussians, small, backend, mask_invalid=True)
    truth, _ = draw(rest, small, backend)
    assert torch.equal(image.color, truth.color)
    assert image.radii[1500] == 0
    for value in gradients.values():
        assert value.isfinite().all()


@pytest.mark.parametrize("name", ["viewmat", "K", "background"])
def test_non_finite_camera_is_refused(name: str) -> None:
    cam, background = camera(), torch.zeros(3)
    tensor = {"viewmat": cam.viewmat, "K": cam.K, "background": background}[name]
    tensor.view(-1)[1] = float("nan")
    with pytest.raises(ValueError, match=rf"^{name}\[.*1\] is nan, expected a finite number$"):
        rasterize(random_gaussians(3), cam, background=background, mask_invalid=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"quaternions": torch.zeros(2, 4)}, r"quaternions has shape \[2, 4\], expected \[3, 4\]"),
        ({"means": torch.zeros(3)}, r"means has shape \[3\], expected \[3, 3\]"),
        ({"opacities": torch.zeros(3, 1)}, r"opacities has shape \[3, 1\], expected \[3\]"),
        ({"features": torch.zeros(3, 33)}, r"features has shape \[3, 33\], expected \[3, at most 32\]"),
        ({"colors": torch.zeros(3, 3, dtype=torch.uint8)}, r"colors is of torch.uint8, expected floating point"),
        ({"means": torch.zeros(3, 3, dtype=torch.complex64)}, r"means is of torch.complex64, expected floating point"),
        ({"features": torch.zeros(3, 2).long()}, r"features is of torch.int64, expected floating point"),
        ({"scales": torch.zeros(3, 3, device="meta")}, r"scales holds no plain array \(.* on meta\)"),
        ({"colors": torch.zeros(3, 3).to_sparse()}, r"colors holds no plain array \(torch.sparse_coo"),
    ],
)
def test_wrong_tensor_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rasterize(replace(random_gaussians(3), **changes), camera(), background=torch.zeros(3))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0}, "the image has 0 x 45 pixels"),
        ({"height": 1 << 21}, "has 70 x 2097152 pixels, expected 1 to 1048576 along each side"),
        ({"near": 0.0}, "near is 0.0, expected more than 0"),
        ({"near": float("inf")}, "near is inf, expected more than 0 and finite"),
        ({"near": float("nan")}, "near is nan, expected more than 0"),
        ({"K": torch.tensor([[9.0, 0, 0], [0, 9, 0], [0, 0, 2]])}, r"K ends in the row \[0.0, 0.0, 2.0\]"),
        ({"K": torch.tensor([[9.0, 0, 0], [0, 9, 0], [0.1, 0, 1]])}, "K ends in the row"),
        ({"viewmat": torch.diag(torch.tensor([-1.0, 1, 1, 1]))}, "viewmat is not a rotation and a translation"),
        ({"viewmat": torch.diag(torch.tensor([2.0, 2, 2, 1]))}, "viewmat is not a rotation"),
        ({"viewmat": torch.diag(torch.tensor([1.0, 1, 1, 2]))}, "viewmat is not a rotation"),
        ({"viewmat": torch.eye(4) + torch.tensor([[0, 0.1, 0, 0]] + 3 * [[0.0] * 4])}, "viewmat is not a rotation"),
        ({"K": torch.tensor([[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]])}, "focal lengths -1.0, 1.0"),
        ({"K": torch.tensor([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]])}, "skew 0.5"),
    ],
)
def test_impossible_camera_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rasterize(random_gaussians(3), replace(camera(), **changes), background=torch.zeros(3))


@pytest.mark.parametrize("option", ["backend", "mode", "precision"])
def test_unknown_option_is_refused_with_what_is_known(option: str) -> None:
    options: dict[str, Any] = {option: "best"}
    with pytest.raises(ValueError, match=f"{option} is 'best', expected one of"):
        rasterize(random_gaussians(3), camera(), background=torch.zeros(3), **options)


@pytest.mark.parametrize("outputs", ["depth", ("depth", "normal")])
def test_unknown_output_is_refused_with_what_is_known(outputs: Any) -> None:
    with pytest.raises(ValueError, match="expected a collection of depth, absolute_gradient, sensitivity"):
        rasterize(random_gaussians(3), camera(), background=torch.zeros(3), outputs=outputs)


def test_unknown_instruction_set_is_refused(subprocess_python: Any) -> None:
    code = "from raster_scenes import *; draw(random_gaussians(3), camera(), 'native')"
    result = subprocess_python(code, AA4D_SIMD="mmx")
    assert "AA4D_SIMD=mmx: this machine has no such kernels; use avx512, avx2 or portable" in result.stderr


@pytest.mark.parametrize("name", ["means", "K", "background", "width"])
def test_what_is_no_tensor_or_no_whole_number_is_named(name: str) -> None:
    gaussians, cam, background = random_gaussians(3), camera(), torch.zeros(3)
    spoil: dict[str, Any] = {"means": np.zeros((3, 3)), "K": np.eye(3), "background": (0, 0, 0), "width": 64.5}
    if name == "means":
        gaussians = replace(gaussians, means=spoil[name])
    elif name == "background":
        background = spoil[name]
    else:
        cam = replace(cam, **{name: spoil[name]})
    with pytest.raises(TypeError, match=rf"^{name} is .*, expected a (torch tensor|whole number)$"):
        rasterize(gaussians, cam, background=background)

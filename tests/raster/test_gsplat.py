"""The gsplat back end without gsplat or a GPU: what it asks of the package, and what it makes of the answer."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest
import torch
from raster_scenes import camera, draw, random_gaussians
from torch import Tensor

from aa4d.raster import Camera, Gaussians, Options, rasterize, reference
from aa4d.raster.cutoffs import CUTOFFS


class FakeGsplat(ModuleType):
    """`gsplat.rasterization` as documented, computed by the reference's parts."""

    def __init__(self) -> None:
        super().__init__("gsplat")
        self.seen: dict[str, Any] = {}

    def rasterization(self, **kwargs: Any) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
        self.seen = kwargs
        camera = Camera(kwargs["viewmats"][0], kwargs["Ks"][0], kwargs["width"], kwargs["height"], kwargs["near_plane"])
        colors = kwargs["colors"]
        gaussians = Gaussians(
            kwargs["means"], kwargs["quats"], kwargs["scales"], kwargs["opacities"], colors[:, :3], colors
        )
        image = reference.rasterize(
            gaussians, camera, kwargs["backgrounds"][0, :3], Options(outputs=frozenset({"depth"}))
        )
        maps = image.features + (1 - image.alpha)[..., None] * kwargs["backgrounds"][0]
        if kwargs["render_mode"] == "RGB+ED":
            maps = torch.cat([maps, image.depth[..., None]], dim=-1)
        # The centres as gsplat keeps them: [1, N, 2], part of the graph.
        projected = reference.project(gaussians, camera, False, CUTOFFS["fast"])
        centers = torch.zeros(1, len(gaussians.means), 2, dtype=maps.dtype)
        centers = centers.index_copy(1, projected.index, projected.centers[None])
        maps = maps + 0 * centers.sum()
        return (
            maps[None],
            image.alpha[None, ..., None],
            {"means2d": centers, "radii": image.radii[None, :, None].expand(1, -1, 2)},
        )


@pytest.fixture
def fake_gsplat(monkeypatch: pytest.MonkeyPatch) -> FakeGsplat:
    fake = FakeGsplat()
    monkeypatch.setitem(sys.modules, "gsplat", fake)
    return fake


def test_maps_come_back_in_their_places(fake_gsplat: FakeGsplat) -> None:
    gaussians = random_gaussians(40, features=3)
    background = torch.tensor([0.25, 0.5, 0.75]).double()
    image = rasterize(
        gaussians, camera(), background=background, outputs=("depth",), backend="gsplat", mode="antialiased"
    )
    truth = rasterize(gaussians, camera(), background=background, outputs=("depth",), backend="reference")
    for name in ("color", "alpha", "depth", "features", "radii"):
        torch.testing.assert_close(getattr(image, name), getattr(truth, name))
    asked = fake_gsplat.seen
    assert asked["rasterize_mode"] == "antialiased"
    assert asked["eps2d"] == 0.3
    assert asked["near_plane"] == camera().near
    assert asked["packed"] is False


@pytest.mark.usefixtures("fake_gsplat")
def test_gradients_pass_through() -> None:
    inputs = replace(random_gaussians(20), means=random_gaussians(20).means.requires_grad_())
    image = rasterize(inputs, camera(), background=torch.zeros(3), backend="gsplat")
    image.color.sum().backward()
    truth = replace(inputs, means=inputs.means.detach().clone().requires_grad_())
    rasterize(truth, camera(), background=torch.zeros(3), backend="reference").color.sum().backward()
    torch.testing.assert_close(inputs.means.grad, truth.means.grad)


@pytest.mark.usefixtures("fake_gsplat")
def test_invalid_gaussian_is_refused_or_masked() -> None:
    gaussians = random_gaussians(10)
    gaussians.scales[3, 1] = float("nan")
    with pytest.raises(ValueError, match=r"scales\[3, 1\] is nan"):
        rasterize(gaussians, camera(), background=torch.zeros(3), backend="gsplat")
    image = rasterize(gaussians, camera(), background=torch.zeros(3), backend="gsplat", mask_invalid=True)
    truth, _ = draw(gaussians, camera(), "reference", mask_invalid=True)
    torch.testing.assert_close(image.alpha, truth.alpha)
    assert image.radii[3] == 0


@pytest.mark.usefixtures("fake_gsplat")
def test_exact_precision_is_refused() -> None:
    with pytest.raises(ValueError, match="gsplat has no precision 'exact'"):
        rasterize(random_gaussians(3), camera(), background=torch.zeros(3), backend="gsplat", precision="exact")


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(
        ModuleNotFoundError, match="needs the package gsplat, which is not installed: pip install gsplat"
    ):
        rasterize(random_gaussians(3), camera(), background=torch.zeros(3), backend="gsplat")

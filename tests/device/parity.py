"""gsplat against the native rasteriser: on the hard cases, on made-up scenes, and on a trained model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

import tests.hard_cases.raster as hard_cases  # it makes raster_scenes importable
from aa4d.capture.reader import read_capture
from aa4d.evaluation.views import view_of_frame
from aa4d.methods.model_file import load_model
from aa4d.raster import Camera, Gaussians, Rendering, rasterize, reference
from aa4d.raster.constants import MAX_ALPHA
from aa4d.raster.cutoffs import CUTOFFS
from aa4d.stress.cases import HardCase
from tests.device.asked import Asked, Keep, attempt

# Of float32 on a GPU with fast exponentials, where no known difference explains more.
MAPS = 1e-4
GRADIENTS = 1e-3
# gsplat 1.5.3 lets alpha rise to this; where the project's own limit binds, the two differ by design.
OTHER_MAX_ALPHA = 0.999
MARGIN = 1e-3  # relative distance from a threshold within which float32 may fall on either side
TILE = 32  # pixels; bounds the memory
# A rehearsal draws these hard cases alone; others take seconds in the reference.
REHEARSED = (
    "covers the whole image",
    "needle: oblique, 1 m",
    "quaternion of any length: 0",
    "opacity of one",
    "no gaussians",
)
# Where gsplat is known to compute something else, by how the name of a hard case begins.
EXPLAINED = {
    "needle": "gsplat inverts the covariance in float32: the determinant of a needle cancels",
    "camera inside a gaussian": "likewise: the covariance is larger than the dilation by more than float32 holds",
    "extreme scales": "likewise, and squares of 1e8 leave float32",
    "near plane of 1e minus 30": "products overflow in float32",
    "far from the origin": "world coordinates are float32: 1e5 m keeps a centimetre",
    "quaternion of any length": "gsplat divides by the quaternion's length: 0 and 1e-30 have none in float32",
    "focal length beyond the image": "pixel coordinates of a telephoto lens are float32",
    "focal length of a thousandth of a pixel": "the covariance on the screen vanishes beside the dilation",
    "colors outside the unit interval": "1e30 times a weight is summed in float32 beside the other terms' rounding",
}


@dataclass(frozen=True)
class Scene:
    gaussians: Gaussians
    camera: Camera
    options: dict[str, Any]


class RecordedError(Exception):
    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.scene = scene


def measure(asked: Asked, keep: Keep) -> None:
    pair = ("gsplat", "native") if asked.device == "cuda" else ("native", "reference")
    keep("compared", {"drawn_by": pair[0], "against": pair[1], "maps": MAPS, "gradients": GRADIENTS})
    rows: dict[str, Any] = {}
    for case in hard_cases.PART.cases:
        if asked.is_tiny and case.name not in REHEARSED:
            continue
        rows[case.name] = attempt(partial(_compare_case, case, pair))
        keep("hard_cases", rows)
    made_up: dict[str, Any] = {}
    for name, scene in made_up_scenes(asked.is_tiny):
        made_up[name] = attempt(partial(compare, scene, pair))
        keep("made_up", made_up)
    if asked.model is not None:
        keep("model", attempt(partial(compare_model, asked, pair)))
    keep("summary", summary(rows | made_up))


def _compare_case(case: HardCase, pair: tuple[str, str]) -> dict[str, Any]:
    return compare(scene_of(case), pair)


def summary(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Names of the scenes by what came of them."""
    beyond = [name for name, row in rows.items() if not row.get("within", False)]
    explained = {name: why for name in beyond for start, why in EXPLAINED.items() if name.startswith(start)}
    return {
        "scenes": len(rows),
        "within_bounds": len(rows) - len(beyond),
        "explained": explained,
        "unexplained": [name for name in beyond if name not in explained],
    }


def scene_of(case: HardCase) -> Scene:
    """The first scene that a hard case draws. Raises ValueError where it draws none."""

    def record(gaussians: Gaussians, camera: Camera, *_: Any, **options: Any) -> Any:
        raise RecordedError(Scene(gaussians, camera, options))

    with _replaced("draw", record), _replaced("errors_against_reference", record):
        try:
            case.run()
        except RecordedError as recorded:
            return recorded.scene
    raise ValueError("draws nothing")


@contextmanager
def _replaced(name: str, value: Any) -> Iterator[None]:
    kept = getattr(hard_cases, name)
    setattr(hard_cases, name, value)
    try:
        yield
    finally:
        setattr(hard_cases, name, kept)


def made_up_scenes(is_tiny: bool) -> Iterator[tuple[str, Scene]]:
    """Ordinary scenes, for what a training asks for: depth, features, the absolute gradient, both modes."""
    camera, random_gaussians = hard_cases.camera, hard_cases.random_gaussians
    count, size = (40, (40, 24, 30.0)) if is_tiny else (2000, (320, 180, 250.0))
    scale = 0.15 if is_tiny else 0.05
    plain = random_gaussians(count, size=scale)
    yield "plain", Scene(plain, camera(*size), {"outputs": ("depth", "absolute_gradient")})
    yield "antialiased", Scene(plain, camera(*size), {"outputs": ("depth",), "mode": "antialiased"})
    for features in (1,) if is_tiny else (1, 3, 32):
        featured = random_gaussians(count, size=scale, features=features)
        yield f"{features} features", Scene(featured, camera(*size), {"outputs": ("depth",)})


def compare(scene: Scene, pair: tuple[str, str]) -> dict[str, Any]:
    """The largest error of each map over decided pixels, and of each gradient in the norm, relative."""
    decided = ~undecided(scene)
    weights = _weights(scene, decided)
    image, gradients = drawn(scene, pair[0], weights)
    truth, true_gradients = drawn(scene, pair[1], weights)
    maps = {}
    for name in ("color", "alpha", "depth", "features"):
        value, true_value = getattr(image, name), getattr(truth, name)
        if value is not None and value.numel():
            value, true_value = value.detach().double().cpu(), true_value.detach().double().cpu()
            off = (value - true_value).abs() / (1 + true_value.abs())
            mask = decided if off.dim() == 2 else decided[..., None].expand_as(off)
            maps[name] = float(off[mask].max()) if mask.any() else 0.0
            maps[name] = maps[name] if value.isfinite().all() else float("inf")
    errors = {name: relative(gradients[name], true) for name, true in true_gradients.items()}
    return {
        "decided": float(decided.double().mean()) if decided.numel() else 1.0,
        "maps": maps,
        "gradients": errors,
        "within": max(maps.values(), default=0.0) <= MAPS and max(errors.values(), default=0.0) <= GRADIENTS,
    }


def drawn(scene: Scene, backend: str, weights: Tensor) -> tuple[Rendering, dict[str, Tensor]]:
    """A picture, and the gradients of the sum of its maps times `weights` [H, W, C]."""
    device = torch.device("cuda" if backend == "gsplat" else "cpu")
    dtype = torch.float64 if backend == "reference" else torch.float32
    given = {name: value for name, value in vars(scene.gaussians).items() if value is not None}
    leaves = {n: value.detach().to(device, dtype, copy=True).requires_grad_() for n, value in given.items()}
    background = torch.tensor([0.25, 0.5, 0.75], device=device, dtype=dtype, requires_grad=True)
    # Poses stay in float64 but on a GPU, which a trained one is not asked of.
    viewmat = scene.camera.viewmat.detach().to(device, dtype if backend == "gsplat" else torch.float64, copy=True)
    viewmat.requires_grad_()
    camera = replace(scene.camera, viewmat=viewmat, K=scene.camera.K.to(device))
    image = rasterize(Gaussians(**leaves), camera, background=background, backend=backend, **scene.options)
    parts = [image.color, image.alpha[..., None]]
    parts += [] if image.depth is None else [image.depth[..., None]]
    parts += [] if image.features is None else [image.features]
    (torch.cat(parts, dim=-1).double() * weights.to(device)).sum().backward()
    gradients = {name: leaf.grad for name, leaf in leaves.items()}
    gradients |= {"background": background.grad, "viewmat": viewmat.grad, "screen": image.screen_gradient}
    if image.screen_gradient_absolute is not None:
        gradients["screen_absolute"] = image.screen_gradient_absolute
    return image, {name: torch.zeros(0) if g is None else g.detach().cpu() for name, g in gradients.items()}


def relative(value: Tensor, truth: Tensor) -> float:
    """In the Euclidean norm; absolute where the truth is zero, infinite where a value is not finite."""
    if not value.isfinite().all():
        return float("inf")
    if value.shape != truth.shape:  # one side has no gradient where nothing is drawn
        return float(value.double().norm() + truth.double().norm())
    error, scale = float((value.double() - truth.double()).norm()), float(truth.double().norm())
    return error / scale if scale > 0 else error


def _weights(scene: Scene, decided: Tensor) -> Tensor:
    """[H, W, C] random ones, zero where a pixel is undecided."""
    features = scene.gaussians.features
    channels = 4 + ("depth" in scene.options.get("outputs", ())) + (0 if features is None else features.shape[1])
    generator = torch.Generator().manual_seed(5)
    weights = torch.randn(*decided.shape, channels, generator=generator, dtype=torch.float64)
    return weights * decided[..., None]


@torch.no_grad()
def undecided(scene: Scene, device: str = "cpu") -> Tensor:
    """[H, W] where the two may rightly disagree: a contribution lies near a threshold, or beyond the limit of alpha."""
    camera, cutoffs = scene.camera, CUTOFFS["fast"]
    gaussians = Gaussians(
        *(None if v is None else v.detach().to(device).double() for v in vars(scene.gaussians).values())
    )
    moved = replace(camera, viewmat=camera.viewmat.detach().to(device).double(), K=camera.K.to(device).double())
    projected = reference.project(gaussians, moved, scene.options.get("mode") == "antialiased", cutoffs)
    found = torch.zeros(camera.height, camera.width, dtype=torch.bool)
    for top in range(0, camera.height, TILE):
        for left in range(0, camera.width, TILE):
            bottom, right = min(top + TILE, camera.height), min(left + TILE, camera.width)
            near = projected.only(reference.touches(projected, left, top, right, bottom))
            y, x = torch.meshgrid(torch.arange(top, bottom), torch.arange(left, right), indexing="ij")
            pixels = torch.stack([x, y], dim=-1).reshape(-1, 2).to(device).double() + 0.5
            dx, dy = (pixels[:, None, :] - near.centers).unbind(-1)
            alpha = near.opacities * torch.exp(-reference.mahalanobis(near, dx, dy) / 2)
            kept = torch.where(alpha >= cutoffs.alpha, alpha.clamp(max=MAX_ALPHA), 0)
            behind = torch.cumprod(1 - kept, dim=-1)
            in_front = torch.cat([torch.ones_like(behind[:, :1]), behind[:, :-1]], dim=-1)
            counts = in_front > cutoffs.transmittance  # what lies behind a finished pixel decides nothing
            close = (alpha / cutoffs.alpha - 1).abs() < MARGIN
            close |= (behind / cutoffs.transmittance - 1).abs() < 2 * MARGIN  # it gathers the errors of all in front
            close |= alpha > MAX_ALPHA * (1 - MARGIN)
            found[top:bottom, left:right] = (close & counts).any(dim=-1).view(bottom - top, right - left).cpu()
    return found


def compare_model(asked: Asked, pair: tuple[str, str]) -> dict[str, Any]:
    """A trained model at three frames: what it decodes on the CPU, drawn by both."""
    if asked.model is None or asked.capture is None:
        raise ValueError("give the model's capture too, with --capture")
    loaded = load_model(Path(asked.model))
    capture = read_capture(Path(asked.capture))
    rows = {}
    for index in (0,) if asked.is_tiny else (0, len(capture.frames) // 2, len(capture.frames) - 1):
        t, camera, _ = view_of_frame(loaded, capture, index)
        with torch.no_grad():
            decoded = loaded.model.gaussians(t, camera, loaded.model.visible(t, camera))
        drawn_only = decoded.opacities > 0
        gaussians = Gaussians(*(None if v is None else v[drawn_only] for v in vars(decoded).values()))
        scene = Scene(gaussians, camera, {"outputs": ("depth",)})
        rows[capture.frames[index].name] = {"gaussians": len(gaussians.means)} | compare(scene, pair)
    return {"frames": rows}

"""Inputs on which a rasteriser tends to lose digits, divide by zero or crash: value and gradient against float64."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch
from raster_scenes import (
    camera,
    draw,
    errors_against_reference,
    one_gaussian,
    random_gaussians,
    relative_error,
    straight_camera,
)
from torch import Tensor

from aa4d.raster import Camera, Gaussians, Rendering, rasterize
from aa4d.stress.cases import Part
from tests.hard_cases.errors import refusal

PART = Part("raster")
REFERENCE = 5e-6  # of maps and of gradients, against the float64 reference


def stack(*parts: Gaussians) -> Gaussians:
    return Gaussians(
        *(torch.cat(values) for values in zip(*(list(vars(part).values())[:5] for part in parts), strict=True))
    )


def worst(gaussians: Gaussians, cam: Camera, **options: Any) -> float:
    return max(errors_against_reference(gaussians, cam, **options)[2].values())


def nothing_drawn(image: Rendering, gradients: dict[str, Tensor]) -> float:
    """The largest of what should all be zero."""
    parts = [image.alpha, image.radii.float(), *(g for name, g in gradients.items() if name != "background")]
    return max(float(part.detach().abs().max()) if part.numel() else 0.0 for part in parts)


def numbers(values: object) -> dict[str, object]:
    return {f"{value:g}" if isinstance(value, float) else str(value): value for value in values}  # type: ignore[attr-defined]


@PART.case(
    why="depth of 0.01 m: the Jacobian grows with 1 / z",
    done="projection in float64",
    bound=REFERENCE,
)
def on_the_near_plane() -> float:
    return worst(one_gaussian(means=[[0.001, 0.002, 0.01]], scales=[[0.003, 0.002, 0.001]]), straight_camera())


@PART.case(
    why="division by a depth of zero, or by a negative one",
    done="not drawn, no gradient",
    each=numbers([0.00999, 0.0, -1e-30, -4.0]),
)
def behind_the_near_plane(z: float) -> float:
    return nothing_drawn(*draw(one_gaussian(means=[[0.0, 0.0, z]]), straight_camera(), "native"))


@PART.case(
    why="beyond the frustum the linearised projection explodes",
    done="the Jacobian's x / z is clamped a little outside the image, in the gradient too",
    bound=REFERENCE,
    each=numbers([30.0, 300.0, 3000.0]),
)
def grazing_far_outside_the_frame(x: float) -> float:
    gaussians = one_gaussian(
        means=[[x, 0.1, 1.0]], scales=[[x / 2, x / 8, 0.1]], quaternions=[[1.0, 0.05, -0.03, 0.02]]
    )
    image, _, errors = errors_against_reference(gaussians, straight_camera(), outputs=("depth",))
    assert image.alpha.max() > 0.01
    return max(errors.values())


@PART.case(why="one Gaussian reaches every tile", done="tiles found by their rectangle", bound=2e-5)
def covers_the_whole_image() -> float:
    gaussians = stack(one_gaussian(scales=[[50.0, 40.0, 2.0]]), one_gaussian())
    image, _, errors = errors_against_reference(gaussians, straight_camera(100, 75))
    assert image.alpha.min() > 0.4
    return max(errors.values())


@PART.case(
    why="the camera stands inside: the ellipse is larger than the image by orders",
    done="the quadratic form is whitened in float64 before it is stored",
    bound=2e-5,
    each=numbers([1.0, 1e3, 1e6]),
)
def camera_inside_a_gaussian(size: float) -> float:
    gaussians = one_gaussian(means=[[0.0, 0.0, 0.02]], scales=[[size, 2 * size, 4 * size]], opacities=[0.7])
    return worst(gaussians, straight_camera())


@PART.case(
    why="its own shape is lost beside the low-pass filter's",
    done="drawn at the filter's size; the gradient of its scale is as small as its scale, and not lost",
    bound=REFERENCE,
)
def smaller_than_a_thousandth_of_a_pixel() -> float:
    _, gradients, errors = errors_against_reference(one_gaussian(scales=[[1e-5, 2e-5, 1e-5]]), straight_camera())
    assert gradients["scales"].abs().max() > 0
    return max(errors.values())


@PART.case(
    why="squares of scales leave float32's digits",
    done="covariances in float64",
    bound=REFERENCE,
    each={f"{scale:g}, {mode}": (scale, mode) for scale in (1e-8, 1e8) for mode in ("classic", "antialiased")},
)
def extreme_scales(given: tuple[float, str]) -> float:
    scale, mode = given
    gaussians = stack(one_gaussian(scales=[[scale, scale * 2, scale]], opacities=[0.9]), one_gaussian())
    return worst(gaussians, straight_camera(), mode=mode)


TURNS = {"along x": [1.0, 0.0, 0.0, 0.0], "oblique": [0.9, 0.1, 0.3, 0.4], "in the plane": [0.92, 0.0, 0.0, 0.38]}


@PART.case(
    why="axes of ratio 1e6: a determinant of the covariance is the difference of equal numbers",
    done="the determinant as a cross product of the covariance's square root",
    bound=1e-5,
    each={f"{name}, {length:g} m": (turn, length) for name, turn in TURNS.items() for length in (1.0, 1000.0)},
)
def needle(given: tuple[list[float], float]) -> float:
    turn, length = given
    return worst(
        one_gaussian(scales=[[length, length * 1e-6, length * 1e-6]], quaternions=[turn], opacities=[0.8]),
        straight_camera(),
    )


@PART.case(
    why="normalising divides by a length of zero or loses it in float32",
    done="zero does not turn and has no gradient; a short one has its direction's gradient over its length",
    bound=REFERENCE,
    each=numbers([0.0, 1e-30, 1e-20, 1e-8, 1e8]),
)
def quaternion_of_any_length(size: float) -> float:
    quaternions = (torch.tensor([[0.9, 0.1, -0.3, 0.2]]) * size).tolist()
    return worst(one_gaussian(quaternions=quaternions, scales=[[0.5, 0.2, 0.1]]), straight_camera())


@PART.case(
    why="the logarithm of an opacity of zero", done="left out before it is taken", each=numbers([0.0, 1e-45, 1e-8])
)
def too_faint_to_draw(opacity: float) -> float:
    return nothing_drawn(*draw(one_gaussian(opacities=[opacity]), straight_camera(), "native"))


@PART.case(
    why="1 - alpha is zero, and the backward pass divides by it",
    done="alpha is clamped to 0.99; where that binds, no gradient passes",
    bound=REFERENCE,
)
def opacity_of_one() -> float:
    gaussians = one_gaussian(opacities=[1.0], scales=[[1.0, 0.8, 1.2]])
    image, gradients, errors = errors_against_reference(gaussians, straight_camera())
    assert gradients["opacities"].count_nonzero() == 1
    return max(*errors.values(), abs(float(image.alpha.detach().max()) - 0.99))


@PART.case(
    why="transmittance underflows; sums run over 5000 terms",
    done="a pixel ends at a transmittance of 1e-4; the backward pass rebuilds it from the end",
    bound=3e-5,
    each=numbers([0.05, 0.6, 1.0]),
)
def thousands_of_layers_on_one_pixel(opacity: float) -> float:
    count = 5000
    generator = torch.Generator().manual_seed(0)
    gaussians = one_gaussian(
        means=[[0.0, 0.0, 3.0 + 1e-3 * i] for i in range(count)],
        opacities=[opacity] * count,
        colors=torch.rand(count, 3, generator=generator).tolist(),
    )
    return worst(gaussians, straight_camera(24, 18, 20.0), outputs=("depth",))


@PART.case(
    why="blocks of pixels hold finished and unfinished ones",
    done="each pixel remembers where it ended",
    bound=3e-5,
)
def many_finished_pixels() -> float:
    gaussians = random_gaussians(1500, 1, size=0.3)
    gaussians = replace(gaussians, opacities=gaussians.opacities.clamp(min=0.5))
    image, _, errors = errors_against_reference(gaussians, camera(), outputs=("depth",))
    assert image.alpha.min() > 0.99
    return max(errors.values())


@PART.case(
    why="an unstable sort would change the picture from run to run",
    done="a stable radix sort: equal depths in the order given",
    bound=REFERENCE,
)
def equal_depths() -> float:
    places = [[0.1 * i, 0.0, 4.0] for i in range(5)]
    colors = [[0.2 * i, 1 - 0.2 * i, 0.5] for i in range(5)]
    gaussians = one_gaussian(means=places, colors=colors)
    image, _, errors = errors_against_reference(gaussians, straight_camera())
    backwards = Gaussians(*(value.flip(0) for value in list(vars(gaussians).values())[:5]))
    assert not torch.equal(draw(backwards, straight_camera(), "native")[0].color, image.color)
    return max(errors.values())


@PART.case(
    why="duplicated points: their gradients differ only by what is in front",
    done="nothing special: blending in order",
    bound=2e-5,
)
def identical_gaussians() -> float:
    gaussians = one_gaussian(opacities=[0.3] * 50)
    _, gradients, errors = errors_against_reference(gaussians, straight_camera(), outputs=("depth",))
    assert (gradients["means"][0] - gradients["means"][-1]).abs().max() > 0
    return max(errors.values())


@PART.case(
    why="world coordinates of 1e5 m: float32 keeps a centimetre",
    done="the difference to the camera's place is taken in float64",
    bound=REFERENCE,
)
def far_from_the_origin() -> float:
    offset = torch.tensor([1e5, -1e5, 1e5], dtype=torch.float64)
    near = one_gaussian(means=[[0.125, -0.25, 4.0], [-0.5, 0.25, 5.0]], scales=[[0.5, 0.2, 0.1]])
    gaussians = replace(near, means=near.means + offset)
    cam = straight_camera()
    viewmat = cam.viewmat.clone()
    viewmat[:3, 3] = -offset
    image, _, errors = errors_against_reference(gaussians, replace(cam, viewmat=viewmat))
    moved = (image.color - draw(near, cam, "native")[0].color).abs().max()
    return max(*errors.values(), float(moved.detach()))


@PART.case(
    why="cropped or shifted lenses: the frustum's clamps must follow",
    done="clamps around the principal point",
    bound=REFERENCE,
    each={"left of the image": (-60.0, 15.0), "far away": (400.0, -300.0)},
)
def principal_point_outside_the_image(center: tuple[float, float]) -> float:
    cam = straight_camera()
    K = cam.K.clone()
    K[0, 2], K[1, 2] = center
    z = 4.0
    x, y = ((20 - center[0]) / 32 * z, (12 - center[1]) / 32 * z)
    gaussians = one_gaussian(means=[[x, y, z]], scales=[[0.5, 0.8, 0.3]])
    image, _, errors = errors_against_reference(gaussians, replace(cam, K=K))
    assert image.alpha.max() > 0.1
    return max(errors.values())


@PART.case(
    why="tiles that reach over the border; images of one pixel",
    done="rows beyond the image have no transmittance and no gradient",
    bound=REFERENCE,
    each={"1 x 1": (1, 1), "1 x 70": (1, 70), "31 x 33": (31, 33), "65 x 2": (65, 2)},
)
def sizes_that_are_no_multiple_of_a_tile(size: tuple[int, int]) -> float:
    return worst(random_gaussians(50, 3, size=0.5), camera(*size, focal=15.0), outputs=("depth",))


@PART.case(
    why="a telephoto lens: a metre is 40,000 pixels, and tile numbers overflow 16 bits",
    done="rectangles are clipped to the image before they become whole numbers",
    bound=REFERENCE,
    each=numbers([1e4, 1e6]),
)
def focal_length_beyond_the_image(focal: float) -> float:
    gaussians = one_gaussian(means=[[0.0, 0.0, 4.0]], scales=[[8 / focal, 20 / focal, 1.0]])
    return worst(gaussians, straight_camera(focal=focal))


@PART.case(
    why="a fisheye's share of a pinhole: a pixel is a metre wide",
    done="projection in float64",
    bound=REFERENCE,
)
def focal_length_of_a_thousandth_of_a_pixel() -> float:
    return worst(one_gaussian(scales=[[500.0, 200.0, 900.0]], opacities=[0.3, 0.5, 0.7]), straight_camera(focal=1e-3))


@PART.case(why="nothing to divide, sort or share out", done="the background, and empty gradients")
def no_gaussians() -> float:
    image, gradients = draw(random_gaussians(0, features=2), camera(17, 3), "native", outputs=("depth",))
    expected = torch.tensor([0.25, 0.5, 0.75]).expand(3, 17, 3)
    assert gradients["means"].shape == (0, 3)
    empty = [image.alpha, image.depth, image.features]
    maps = [m.detach() for m in (image.color - expected, *empty)]  # type: ignore[union-attr,operator]
    return max(nothing_drawn(image, gradients), *(float(m.abs().max()) for m in maps))


@PART.case(
    why="an infinite gradient of one pixel times a weight of zero is NaN everywhere",
    done="it spoils the Gaussians that reach the pixel, and no other",
)
def gradient_that_is_not_finite() -> float:
    gaussians = one_gaussian(means=[[-1.5, 0.0, 4.0], [1.5, 0.0, 4.0]])
    cam = straight_camera()
    weights = torch.ones(cam.height, cam.width, 4)
    weights[15, 8] = float("inf")
    _, gradients = draw(gaussians, cam, "native", weights)
    assert not gradients["means"][0].isfinite().all()
    return 0.0 if gradients["means"][1].isfinite().all() else math.inf


@PART.case(
    why="scales of 1e20 at a depth of 1e-25 overflow every product",
    done="what does not fit is bounded: maps and gradients stay finite",
)
def near_plane_of_1e_minus_30() -> float:
    cam: Camera = straight_camera(near=1e-30)
    gaussians = stack(one_gaussian(means=[[0.0, 0.0, 1e-25]], scales=[[1e20, 1e20, 1e20]]), one_gaussian())
    image, gradients = draw(gaussians, cam, "native")
    return 0.0 if all(value.isfinite().all() for value in (image.color, *gradients.values())) else math.inf


@PART.case(
    why="a colour is unbounded in training: harmonics and exposure overshoot",
    done="blended as they are, in float32",
    bound=REFERENCE,
    each=numbers([-3.0, 1e4, 1e30]),
)
def colors_outside_the_unit_interval(value: float) -> float:
    gaussians = one_gaussian(colors=[[value, 0.5 * value, 0.2]])
    image, gradients = draw(gaussians, straight_camera(), "native")
    truth, expected = draw(gaussians, straight_camera(), "reference")
    pairs = [(image.color, truth.color), *((gradients[name], expected[name]) for name in gradients)]
    return max(relative_error(a, b) if a.isfinite().all() else math.inf for a, b in pairs)


@PART.case(
    why="one Gaussian of thousands that holds a NaN would spoil the sort, its tiles and every gradient",
    done="refused with the tensor, the row and the value, or left out on demand",
    each=numbers(["means", "quaternions", "scales", "opacities", "colors"]),
)
def one_nan_in_thousands(name: str) -> float:
    gaussians = random_gaussians(2000)
    tensor = getattr(gaussians, name).clone()
    tensor[1500].view(-1)[-1] = math.nan
    spoiled, small = replace(gaussians, **{name: tensor}), camera(16, 12, 14)
    refused = refusal(ValueError, lambda: rasterize(spoiled, small, background=torch.zeros(3)), name, "1500", "nan")
    rest = Gaussians(*(None if v is None else torch.cat([v[:1500], v[1501:]]) for v in vars(gaussians).values()))  # type: ignore[arg-type]
    image, gradients = draw(spoiled, small, "native", mask_invalid=True)
    assert all(value.isfinite().all() for value in gradients.values())
    return max(refused, float((image.color - draw(rest, small, "native")[0].color).abs().max()))

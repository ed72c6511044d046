"""What the search draws at random: inputs of extreme scale for each part, and their error against float64.

An input is a dataclass of plain numbers, so that what is found can be pasted into Python.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from hypothesis import assume
from hypothesis import strategies as st
from raster_scenes import draw, maps, one_gaussian, random_weights, straight_camera, undecided_pixels
from scipy.spatial.transform import Rotation
from torch import Tensor

from aa4d.kernels.image_loss import _image_loss, image_loss
from aa4d.kernels.local_gaussians import _local_gaussians, local_gaussians
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.plane_penalty import _plane_penalty, plane_penalty
from aa4d.kernels.two_layer import _two_layer, two_layer
from aa4d.methods.adaanchor4d.warping import CoordinateWarp, density_adaptive_boundaries
from aa4d.motion.fit import Priors, Sightings, fit_track
from aa4d.motion.groups import pose_of
from aa4d.motion.spline import design
from aa4d.stress.cases import Search
from aa4d.training.poses import exponential
from synth.flight.orientation import look_at
from synth.traffic.following import ballistic, idm_acceleration, within_gap
from synth.traffic.settings import Traffic
from tests.hard_cases.errors import values_and_gradients


def sizes(least: float = -30, most: float = 30) -> Any:
    """A number of either sign whose magnitude is anything between two powers of ten, or zero, or denormal."""
    power = st.floats(least, most, width=32).map(lambda x: float(np.float32(10.0**x)))
    signed = st.tuples(power, st.sampled_from([1.0, -1.0])).map(lambda pair: pair[0] * pair[1])
    return st.one_of(signed, st.sampled_from([0.0, 1.0, -1.0, 1e-45, -1e-40, 1e-38]))


def worst_of(found: list[Tensor], truths: list[Tensor], scales: list[float]) -> float:
    """Largest difference over the scale of what was added up to make the value; infinite where only `found` is."""
    worst = 0.0
    for value, truth, scale in zip(found, truths, scales, strict=True):
        if not value.numel():
            continue
        fits = truth.abs() < 1e37  # what float32 can hold, with room for sums
        if not value[fits].isfinite().all():
            return math.inf
        off = (value.double() - truth.double()).abs()[fits]
        if off.numel():
            worst = max(worst, float(off.max()) / max(scale, 1e-37))
    return worst


# Rasteriser


@dataclass(frozen=True)
class Splat:
    """One Gaussian before a straight camera, with another one behind it."""

    mean: tuple[float, float, float]
    scale: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    opacity: float
    focal: float
    antialiased: bool


def splats() -> Any:
    scale = sizes(-12, 4).map(abs)
    place = st.tuples(sizes(-6, 6), sizes(-6, 6), sizes(-4, 6).map(abs))
    quaternion = st.tuples(sizes(-20, 20), sizes(-20, 20), sizes(-20, 20), sizes(-20, 20))
    return st.builds(
        Splat,
        place,
        st.tuples(scale, scale, scale),
        quaternion,
        st.floats(0, 1, width=32),
        st.sampled_from([0.01, 8.0, 32.0, 1e3, 1e5]),
        st.booleans(),
    )


def splat_error(x: Splat) -> float:
    """Of the maps, absolute; gradients may be a thousand times as far off, for those of a needle cancel in float32."""
    gaussians = one_gaussian(
        means=[list(x.mean), [0.1, -0.2, 4.0]],
        scales=[list(x.scale), [0.3, 0.2, 0.4]],
        quaternions=[list(x.quaternion), [0.9, 0.1, -0.3, 0.2]],
        opacities=[x.opacity, 0.5],
        colors=[[0.2, 0.4, 0.6], [0.9, 0.1, 0.3]],
    )
    cam = straight_camera(24, 18, x.focal)
    options: dict[str, Any] = {"mode": "antialiased" if x.antialiased else "classic"}
    decided = ~undecided_pixels(gaussians, cam, 1e-4, **options)
    weights = random_weights(cam, 4) * decided[..., None]
    truth, true_gradients = draw(gaussians, cam, "reference", weights, **options)
    image, gradients = draw(gaussians, cam, "native", weights, **options)
    found = maps(image).detach()
    if not found.isfinite().all():
        return math.inf
    worst = float(((found.double() - maps(truth).detach()).abs() * decided[..., None]).max())
    for name, gradient in gradients.items():
        true = true_gradients[name]
        if not true.isfinite().all():
            continue
        fits = true.abs() < 1e37
        if not gradient[fits].isfinite().all():
            return math.inf
        worst = max(worst, float(((gradient.double() - true)[fits]).norm() / true[fits].norm().clamp_min(1e-20)) / 1e3)
    return worst


# Kernels of the field


@dataclass(frozen=True)
class Query:
    """Places and scores of two anchors, and the size of the planes' values."""

    u: tuple[float, ...]  # 6
    t: float
    score: tuple[float, ...]  # 12
    size: float
    is_product: bool


def queries() -> Any:
    times = st.one_of(st.floats(0, 1, width=32), sizes(), st.sampled_from([1.0 - 2**-24, 2.0**-149]))
    places = st.tuples(*[st.one_of(st.floats(-1, 1, width=32), sizes())] * 6)
    return st.builds(Query, places, times, st.tuples(*[sizes()] * 12), sizes(-6, 6), st.booleans())


def query_error(x: Query) -> float:
    generator = torch.Generator().manual_seed(0)
    shapes = [(4, 3), (3, 5), (3, 5), (6, 3), (6, 4), (6, 5)]
    planes = [((torch.rand(*s, 2, generator=generator) + 0.5) * x.size).requires_grad_() for s in shapes]
    u = torch.tensor(x.u).view(2, 3)
    scores = torch.tensor(x.score).view(2, 6, 1).expand(2, 6, 2).clone().requires_grad_()
    inputs = planes if x.is_product else [*planes, scores]

    def run(f: Any, dtype: torch.dtype) -> Any:
        # float64 sees the same time within the clip: outside, the first and the last row hold.
        t = min(max(x.t, 0.0), 1.0)
        return lambda v: [f(v[:6], u.to(dtype), t, None if x.is_product else v[6])]

    found = values_and_gradients(run(look_up, torch.float32), inputs)
    double = [v.detach().double().requires_grad_() for v in inputs]
    truths = values_and_gradients(run(_look_up, torch.float64), double)
    size = abs(x.size)
    value = size**6 if x.is_product else size
    slope = size**5 if x.is_product else 1.0
    return worst_of(found, truths, [12 * value, *[24 * slope] * 6, *([] if x.is_product else [12 * value])])


@dataclass(frozen=True)
class Net:
    """A network of two inputs, three hidden units and two outputs, each weight of any size."""

    x: tuple[float, ...]  # 4: two rows
    w1: tuple[float, ...]  # 9: with the time
    b1: tuple[float, ...]  # 3
    w2: tuple[float, ...]  # 6
    t: float


def nets() -> Any:
    def some(n: int) -> Any:
        return st.tuples(*[sizes(-15, 9)] * n)

    return st.builds(Net, some(4), some(9), some(3), some(6), st.floats(0, 1, width=32))


def net_error(x: Net) -> float:
    inputs = [
        torch.tensor(x.x).view(2, 2),
        torch.tensor(x.w1).view(3, 3),
        torch.tensor(x.b1),
        torch.tensor(x.w2).view(2, 3),
        torch.zeros(2),
    ]
    inputs = [v.requires_grad_() for v in inputs]
    t = float(np.float32(x.t))
    with_time = torch.cat([inputs[0], torch.full((2, 1), t)], 1).double().detach()
    w1, b1 = inputs[1].detach().double(), inputs[2].detach().double()
    hidden = torch.nn.functional.linear(with_time, w1, b1)
    magnitude = torch.nn.functional.linear(with_time.abs(), w1.abs(), b1.abs())  # of what is added up
    # At a ReLU's kink float32, which has nothing below 1e-45, and float64 may rightly disagree, unless nothing is added
    # up at all.
    assume(bool(((magnitude == 0) | (hidden.abs() > (1e-5 * magnitude).clamp(min=1e-37))).all()))
    found = values_and_gradients(lambda v: two_layer(v[0], [tuple(v[1:])], t), inputs)  # type: ignore[list-item]
    double = [v.detach().double().requires_grad_() for v in inputs]
    truths = values_and_gradients(lambda v: _two_layer(v[0], [tuple(v[1:])], t), double)  # type: ignore[list-item]
    absolute = [v.detach().abs().requires_grad_() for v in double]  # what is added up, without cancelling
    bounds = values_and_gradients(lambda v: _two_layer(v[0], [tuple(v[1:])], t), absolute)  # type: ignore[list-item]
    return worst_of(found, truths, [float(b.abs().max()) * 10 for b in bounds])


@dataclass(frozen=True)
class Decoded:
    """What the decoders say for one anchor with one Gaussian."""

    position: tuple[float, float, float]
    offset: tuple[float, float, float]
    scale: tuple[float, ...]  # 6
    opacity: float
    color: tuple[float, float, float]
    covariance: tuple[float, ...]  # 7


def decodeds() -> Any:
    three = st.tuples(*[sizes(-15, 15)] * 3)
    wild = st.one_of(sizes(), st.floats(-30, 30, width=32))
    positive = st.tuples(*[sizes(-15, 9).map(abs)] * 6)
    return st.builds(Decoded, three, three, positive, wild, st.tuples(wild, wild, wild), st.tuples(*[wild] * 7))


def decoded_error(x: Decoded) -> float:
    """Relative, value by value; gradients of saturated values against the slope of one that is not."""
    tensors = [torch.tensor([x.position]), torch.tensor([[x.offset]]), torch.tensor([x.scale])]
    tensors += [torch.tensor([[x.opacity]]), torch.tensor([x.color]), torch.tensor([x.covariance])]

    def parts(f: Any) -> Any:
        return lambda v: [value for value in vars(f(*v)).values() if value is not None]

    found = values_and_gradients(parts(local_gaussians), [v.requires_grad_() for v in tensors])
    double = [v.detach().double().requires_grad_() for v in tensors]
    truths = values_and_gradients(parts(_local_gaussians), double)
    worst = 0.0
    largest = max(1.0, *(abs(v) for v in (*x.offset, *x.scale)))
    for i, (value, truth) in enumerate(zip(found, truths, strict=True)):
        scale = truth.abs().clamp_min(1e-24)  # e to less than -87 is taken for 1e-38
        if i == 0:  # position + offset * scale may cancel
            scale = scale + torch.tensor([[abs(p) for p in x.position]])
        if i >= 5:
            scale = scale.clamp_min(0.1 * largest)
        if not value[truth.abs() < 1e37].isfinite().all():
            return math.inf
        worst = max(worst, float(((value.double() - truth).abs() / scale)[truth.abs() < 1e37].max()))
    return worst


@dataclass(frozen=True)
class Picture:
    """Pixels of a picture and its target, a row of them."""

    image: tuple[float, ...]
    target: tuple[float, ...]
    height: int


def pictures() -> Any:
    value = st.one_of(st.floats(0, 1, width=32), st.sampled_from([0.0, 1.0, 1e-45, 0.5]), st.floats(-4, 4, width=32))

    def of(pixels: int) -> Any:
        values = st.lists(value, min_size=3 * pixels, max_size=3 * pixels).map(tuple)
        return st.builds(Picture, values, values, st.sampled_from([n for n in (1, 2, 3, 4, 6) if pixels % n == 0]))

    return st.integers(1, 12).flatmap(of)


def picture_error(x: Picture) -> float:
    image = torch.tensor(x.image).view(x.height, -1, 3).requires_grad_()
    target = torch.tensor(x.target).view(x.height, -1, 3)
    found = values_and_gradients(lambda v: image_loss(v[0], target, 0.2)[:1], [image])
    double = [image.detach().double().requires_grad_()]
    truths = values_and_gradients(lambda v: _image_loss(v[0], target.double(), 0.2)[:1], double)
    return worst_of(found, truths, [max(1.0, float(truths[0].abs().max())), max(1.0, float(truths[1].abs().max()))])


@dataclass(frozen=True)
class Rows:
    """A plane of one column and channel."""

    values: tuple[float, ...]
    smoothness: float
    constancy: float


def rows() -> Any:
    weight = st.floats(-9, 3).map(lambda power: 10.0**power)
    return st.builds(Rows, st.lists(sizes(-20, 15), min_size=1, max_size=6).map(tuple), weight, weight)


def rows_error(x: Rows) -> float:
    plane = torch.tensor(x.values).view(-1, 1, 1).requires_grad_()
    smooth, constant = float(np.float32(x.smoothness)), float(np.float32(x.constancy))
    found = values_and_gradients(lambda v: [plane_penalty(v, [smooth], [constant])], [plane])
    double = [plane.detach().double().requires_grad_()]
    truths = values_and_gradients(lambda v: [_plane_penalty(v, [smooth], [constant])], double)
    most = max(1.0, *(abs(v) for v in x.values))
    return worst_of(found, truths, [16 * (smooth * most**2 + constant * most), 64 * (smooth * most + constant)])


# DACW


@dataclass(frozen=True)
class Mass:
    """Places of anchors along an axis, each with how many there are, and the warp's settings."""

    places: tuple[tuple[float, int], ...]
    bins: int
    smoothing: float
    gamma: float
    strengths: tuple[float, float]


def masses() -> Any:
    place = st.one_of(st.floats(-1, 1, width=32), sizes(), st.sampled_from([-1.0, 1.0, 1 - 2**-24]))
    places = st.lists(st.tuples(place, st.sampled_from([1, 10, 1000])), max_size=4).map(tuple)
    strengths = st.tuples(st.floats(0, 1), st.floats(0, 1)).map(lambda pair: (min(pair), max(pair)))
    gamma = st.one_of(st.floats(0, 100), sizes(-30, 6).map(abs))
    return st.builds(Mass, places, st.sampled_from([1, 2, 7, 64, 500]), st.floats(0, 1e3), gamma, strengths)


def mass_error(x: Mass) -> float:
    """How far the map is from a monotone one of [-1, 1] onto itself."""
    u = torch.cat([torch.zeros(0), *(torch.full((n,), place) for place, n in x.places)])[:, None].repeat(1, 3)
    boundaries = density_adaptive_boundaries(u, x.bins, x.smoothing, x.gamma, *x.strengths)
    warp = CoordinateWarp(x.bins)
    warp.boundaries.copy_(boundaries)
    warped = warp(torch.linspace(-1.1, 1.1, 400)[:, None].repeat(1, 3))
    if not (boundaries.isfinite().all() and warped.isfinite().all()):
        return math.inf
    ends = max(float((boundaries[:, 0] + 1).abs().max()), float((boundaries[:, -1] - 1).abs().max()))
    backwards = max(0.0, -float(boundaries.diff().min()), -float(warped.diff(dim=0).min()))
    return max(ends, backwards, float(warped.abs().max()) - 1)


# Motion and poses


@dataclass(frozen=True)
class Turn:
    """A rotation vector."""

    omega: tuple[float, float, float]


def turns() -> Any:
    return st.builds(Turn, st.tuples(*[sizes(-30, 3)] * 3))


def turn_error(x: Turn) -> float:
    twist = torch.tensor([*x.omega, 1.0, 2.0, 3.0], dtype=torch.float64, requires_grad=True)
    found = exponential(twist)
    (gradient,) = torch.autograd.grad(found.sum(), twist)
    if not gradient.isfinite().all():
        return math.inf
    truth = Rotation.from_rotvec(np.array(x.omega)).as_matrix()
    heading = pose_of(
        torch.zeros(1, 3).double(), torch.tensor([x.omega[0]]).double(), torch.tensor([0.0, 0, 1]).double()
    )
    true_heading = Rotation.from_rotvec([0, 0, torch.tensor([x.omega[0]]).double().item()]).as_matrix()
    off = np.abs(found.detach().numpy()[:3, :3] - truth).max()
    return max(float(off), float(np.abs(heading.rotation[0].numpy() - true_heading).max()))


@dataclass(frozen=True)
class Way:
    """Sightings of a mover along a line, as (time, place)."""

    seen: tuple[tuple[float, float], ...]
    frames: int
    deviation: float


def ways() -> Any:
    sighting = st.tuples(st.floats(0, 1), sizes(-6, 7))
    seen = st.lists(sighting, min_size=1, max_size=6, unique_by=lambda pair: pair[0]).map(lambda s: tuple(sorted(s)))
    return st.builds(Way, seen, st.sampled_from([1, 2, 10, 100]), st.sampled_from([1e-6, 0.1, 1e3]))


def way_error(x: Way) -> float:
    """How far the track leaves what was seen, in multiples of its extent."""
    t, place = np.array([s[0] for s in x.seen]), np.array([s[1] for s in x.seen])
    n = len(t)
    position = np.stack([place, np.zeros(n), np.zeros(n)], 1)
    nothing = np.full((n, 3), np.nan)
    sightings = Sightings(t, position, np.full(n, x.deviation), nothing, np.full(n, 0.1), np.full(n, np.nan))
    control = fit_track(sightings, 7, x.frames, np.array([0.0, 0, 1]), Priors(0.01, 0.01))
    if not np.isfinite(control).all():
        return math.inf
    way = (design(t, 7) @ control[:, :3])[:, 0]
    return float(np.abs(way - place).max() / max(np.ptp(place), 1e-6 * np.abs(place).max(), x.deviation))


# Synth


@dataclass(frozen=True)
class Follower:
    """Who follows a vehicle that stands."""

    gap_m: float
    speed_mps: float
    cruise_mps: float
    step_s: float


def followers() -> Any:
    return st.builds(
        Follower,
        sizes(-30, 3).map(abs),
        sizes(-30, 2).map(abs),
        sizes(-3, 2).map(lambda v: max(abs(v), 1e-3)),
        st.sampled_from([0.02, 0.1, 0.5, 1.0]),
    )


def follower_error(x: Follower) -> float:
    """How far it drives into the vehicle ahead, or backwards."""
    position, speed = np.zeros(1), np.array([x.speed_mps])
    traffic, worst = Traffic(step_s=x.step_s), 0.0
    for _ in range(200):
        gap = x.gap_m - position
        acceleration = idm_acceleration(speed, np.array([x.cruise_mps]), gap, speed, traffic)
        acceleration = within_gap(acceleration, speed, gap, np.zeros(1), x.step_s)
        before = position
        position, speed = ballistic(position, speed, acceleration, x.step_s)
        if not (np.isfinite(position).all() and np.isfinite(speed).all()):
            return math.inf
        worst = max(worst, float(position[0] - x.gap_m), float(before[0] - position[0]), -float(speed[0]))
    return worst


@dataclass(frozen=True)
class Look:
    """Where a camera stands, and what it looks at from there."""

    position: tuple[float, float, float]
    beside: tuple[float, float, float]


def looks() -> Any:
    return st.builds(Look, st.tuples(*[sizes(-6, 4)] * 3), st.tuples(*[sizes(-6, 4)] * 3))


def look_error(x: Look) -> float:
    """How far the camera's axes are from a rotation, and its axis from the target."""
    position = np.array(x.position)
    target = position + np.array(x.beside)
    way = target - position
    assume(np.linalg.norm(way) > 0)
    rotation = look_at(position, target, None)
    if not np.isfinite(rotation).all():
        return math.inf
    aside = np.abs(rotation[:, 2] - way / np.linalg.norm(way)).max()
    return float(max(np.abs(rotation @ rotation.T - np.eye(3)).max(), aside, abs(np.linalg.det(rotation) - 1)))


SEARCHES = (
    Search("raster", "a Gaussian of any place, size and turn", splats, 1e-5, splat_error),
    Search("plane_lookup", "places, times and scores of any size", queries, 1e-5, query_error),
    Search("plane_lookup", "the penalty of rows of any size", rows, 1e-6, rows_error),
    Search("acfa", "networks of any size", nets, 1e-5, net_error),
    Search("anchors", "decoder outputs of any size", decodeds, 1e-5, decoded_error),
    Search("losses", "small pictures", pictures, 1e-4, picture_error),
    Search("dacw", "histograms", masses, 1e-6, mass_error),
    Search("optimiser", "twists and headings", turns, 1e-9, turn_error),
    Search("groups", "tracks of a few sightings", ways, 10.0, way_error),
    # From 100 m/s, what is taken for a stop at once (AT_ONCE_MPS2) is 5 micrometres long.
    Search("traffic", "a follower of a vehicle that stands", followers, 1e-5, follower_error),
    Search("flight", "cameras that look anywhere", looks, 1e-9, look_error),
)

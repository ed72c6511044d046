"""What the points of an imported object carry: the values of every attribute at one time, as numpy arrays.

Two carriers: the anchors, one point each, and the local Gaussians, K points an anchor.
"""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from . import names, sights
from .clip import Clip
from .container import Floats, ModelFileError
from .field import (
    AnchorState,
    Field,
    anchor_appearance,
    anchor_positions,
    anchor_state,
    centers,
    in_model_frame,
    local_gaussians,
    plane_weights,
    presence,
    to_world,
)
from .harmonics import degree_of
from .knots import Knots
from .model import Doubles

# How many standard deviations of its Gaussians an anchor's point reaches: fewer leave gaps, more hide small neighbours.
RADIUS_SIGMAS = 1.5
SPEED_STEP = 0.5  # frames to either side: the mean speed over the frame


def points_per_anchor(field: Field, carrier: str) -> int:
    """K for the local Gaussians, 1 for the anchors themselves."""
    return field.model.config.offsets if carrier == names.GAUSSIANS else 1


@np.errstate(over="ignore", invalid="ignore")  # what overflows is found below
def evaluate(
    field: Field,
    carrier: str,
    t: float,
    camera_center: Doubles,
    wanted: Collection[names.Attribute],
    knots: Knots | None = None,
) -> dict[names.Attribute, Floats]:
    """The attributes of the carrier at time t, one row a point, as a camera at `camera_center` [3] (metres) sees them.

    Of `names.SHAPE`, `names.INSPECTION` and, of Gaussians, `names.HARMONICS` what is wanted; the others always. `knots`
    make it quicker and less exact.

    Raises:
        ModelFileError: the model's numbers overflow there.
    """
    shape = names.SCALE in wanted
    offsets = carrier == names.GAUSSIANS
    mixed = None if knots is None else knots.at(field, t, offsets=offsets)
    state = anchor_state(field, t, offsets=offsets, mixed=mixed)
    if carrier == names.ANCHORS:
        values = _anchors(field, state, camera_center, shape=shape)
    else:
        gaussians = local_gaussians(field, state, camera_center)
        values = {
            names.POSITION: gaussians.positions.reshape(-1, 3),
            names.COLOR: linear_rgba(gaussians.colors.reshape(-1, 3)),
            names.OPACITY: np.maximum(gaussians.opacities, 0).reshape(-1),
            names.RADIUS: radius(gaussians.scales.reshape(-1, 3)),
            names.SCALE: gaussians.scales.reshape(-1, 3),
            names.ROTATION: gaussians.quaternions.reshape(-1, 4),
        }
        terms = harmonics_of(wanted)
        if terms:
            fitted = sights.fitted_over_cameras(field, state, gaussians, degree_of(len(terms)))
            values |= dict(zip(terms, fitted.swapaxes(0, 1), strict=True))
    repeats = points_per_anchor(field, carrier)
    hide_absent(values, np.repeat(presence(field, state) > 0, repeats))
    for attribute, value in _inspect(field, t, state, wanted).items():
        values[attribute] = np.repeat(value, repeats)
    check_finite(values, field.model, t)
    return values


def harmonics_of(attributes: Collection[names.Attribute]) -> tuple[names.Attribute, ...]:
    """Those of the attributes that are terms of harmonics, in order."""
    return tuple(term for term in names.HARMONICS if term in attributes)


def color_errors(
    field: Field, t: float, camera_center: Doubles, values: Mapping[names.Attribute, Floats]
) -> tuple[float, float] | None:
    """`sights.color_errors` of Gaussians that were evaluated with harmonics at t, seen from `camera_center`."""
    state = anchor_state(field, t)
    fitted = np.stack([values[term] for term in harmonics_of(values)], axis=1)
    return sights.color_errors(field, state, local_gaussians(field, state, camera_center), fitted)


def radius(scales: Floats) -> Floats:
    """What a point is drawn with [n], from standard deviations [n, 3]: the reach of the two largest ones."""
    largest = np.partition(scales, 1, axis=1)[:, 1:]
    return np.float32(RADIUS_SIGMAS) * np.sqrt(largest[:, 0] * largest[:, 1])


def check_finite(values: Mapping[names.Attribute, Floats], clip: Clip, t: float) -> None:
    """Raises ModelFileError where the numbers of the file overflowed at t."""
    for attribute in (names.POSITION, names.COLOR, names.RADIUS):
        if not np.isfinite(values[attribute]).all():
            raise ModelFileError(
                f"{clip.path.name} gives values that are not finite at {t:.3f} of the clip; train it again."
            )


def positions(field: Field, carrier: str, t: float) -> Floats:
    """Positions [points, 3] alone, world metres: for trails."""
    if carrier == names.ANCHORS:
        return to_world(field.model, anchor_positions(field, t))
    state = anchor_state(field, t)
    places = state.positions[:, None] + state.offsets * state.scales[:, None, :3]
    places = in_model_frame(field.model, state.poses, places, slice(0, len(places)))
    return to_world(field.model, places.reshape(-1, 3))


def hide_absent(values: dict[names.Attribute, Floats], there: np.ndarray) -> None:
    """Take the size of what is not there: an opaque look that draws every opacity draws nothing of it either."""
    if not there.all():
        values[names.RADIUS] = values[names.RADIUS] * there
        if names.SCALE in values:
            values[names.SCALE] = values[names.SCALE] * there[:, None]


def _anchors(field: Field, state: AnchorState, camera_center: Doubles, *, shape: bool) -> dict[names.Attribute, Floats]:
    """One point an anchor: its Gaussians' colours weighted by their opacity; opacity and shape of the most opaque one.

    The radius is the opacity-weighted mean of the Gaussians' reach. The shape is scaled to that radius. A group that
    fades in or out loses opacity alone.
    """
    colors, opacities, reach = anchor_appearance(field, state, camera_center)
    opacity = np.maximum(opacities, 0)
    share = opacity + np.float32(1e-6)  # an anchor without a visible Gaussian keeps the plain mean
    share /= share.sum(axis=1, keepdims=True)
    radius = np.float32(RADIUS_SIGMAS) * np.einsum("nk,nk->n", share, reach)
    values = {
        names.POSITION: to_world(field.model, centers(field, state)),
        names.COLOR: linear_rgba(np.matmul(share[:, None], colors)[:, 0]),
        names.OPACITY: opacity.max(axis=1) * presence(field, state),
        names.RADIUS: radius,
    }
    if shape:
        gaussians = local_gaussians(field, state, camera_center)
        row, best = np.arange(len(opacity)), opacity.argmax(axis=1)
        grown = radius / np.maximum(np.float32(RADIUS_SIGMAS) * reach[row, best], np.float32(1e-12))
        values[names.SCALE] = gaussians.scales[row, best] * grown[:, None]
        values[names.ROTATION] = gaussians.quaternions[row, best]
    return values


def _inspect(
    field: Field, t: float, state: AnchorState, wanted: Collection[names.Attribute]
) -> dict[names.Attribute, Floats]:
    """The wanted diagnostics, one value an anchor."""
    model = field.model
    values: dict[names.Attribute, Floats] = {}
    if names.DISPLACEMENT in wanted:
        moved = centers(field, state) - field.canonical
        values[names.DISPLACEMENT] = np.float32(model.scale) * np.linalg.norm(moved, axis=1)
    if names.SPEED in wanted:
        speed = mean_speed(model, t, lambda at: anchor_positions(field, at))
        values[names.SPEED] = np.float32(model.scale) * speed
    if not set(names.WEIGHTS).isdisjoint(wanted):
        values |= dict(zip(names.WEIGHTS, plane_weights(field, t).T, strict=True))
    return values


def mean_speed(clip: Clip, t: float, positions_at: Callable[[float], Floats]) -> Floats:
    """The mean speed [n] over the frame around t, a second, in the unit of the positions [n, 3]; zero in a clip of one
    frame."""
    last = len(clip.ranks) - 1
    if last == 0:
        return np.zeros(len(positions_at(t)), np.float32)
    before, after = max(t - SPEED_STEP / last, 0.0), min(t + SPEED_STEP / last, 1.0)
    way = positions_at(after) - positions_at(before)
    return np.float32(1 / clip.seconds_between(before, after)) * np.linalg.norm(way, axis=1)


def linear_rgba(srgb: Floats) -> Floats:
    """sRGB colours [n, 3] as linear ones with alpha 1, [n, 4] (IEC 61966-2-1)."""
    rgba = np.ones((len(srgb), 4), np.float32)
    np.power((srgb + np.float32(0.055)) * np.float32(1 / 1.055), np.float32(2.4), out=rgba[:, :3])
    np.copyto(rgba[:, :3], srgb * np.float32(1 / 12.92), where=srgb <= np.float32(0.04045))
    return rgba

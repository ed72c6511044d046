"""Evaluating a model at any time with numpy (docs/formats.md, "Evaluating a model at time t").

What does not depend on the time is computed once, in `prepare`: the spatial planes at every anchor, where each anchor
falls on the temporal planes, and the embedding's share of the first layers. A time then costs one interpolation between
two rows of each temporal plane, a gather, and the small networks. Arrays over the planes have them along the first
axis: sums over planes then run along memory.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .container import Floats, ModelFileError
from .groups import Poses
from .model import PLANES, WEIGHTED, Doubles, Model
from .products import over_chunks, product

Indices = npt.NDArray[np.intp]

MEMORY_RATIO = 64  # of what `prepare` keeps to the size of the file; the default configuration needs about 4
TIME_NETWORK_BIASES = ("acfa.hidden.bias", "dlgd_offset.hidden.bias", "dlgd_scale.hidden.bias")


@dataclass(frozen=True)
class TemporalPlane:
    """One of xt, yt, zt at one level, and where the anchors fall along its spatial axis."""

    rows: Floats  # [R2, R1, C], time along the first axis
    left: Indices  # [N]
    fraction: Floats  # [N, 1]


@dataclass(frozen=True)
class Level:
    """One resolution of the field."""

    spatial: Floats  # [3, N, C]: xy, xz, yz at the anchors
    temporal: tuple[TemporalPlane, ...]  # xt, yt, zt


@dataclass(frozen=True)
class TimeNetwork:
    """output(relu(hidden([embedding, t]))) with the embedding's share of the hidden layer already summed."""

    static: Floats  # [N, H], or [1, H] where there is no embedding: the same for every anchor
    time: Floats  # [H]
    weight: Floats  # [outputs, H]
    bias: Floats  # [outputs]

    def __call__(self, t: float, part: slice) -> Floats:
        """Evaluate at t for a slice of the anchors: [n, outputs] or [1, outputs]."""
        static = self.static[part] if len(self.static) > 1 else self.static
        return _output(_relu(static + np.float32(t) * self.time), self.weight, self.bias)


@dataclass(frozen=True)
class Field:
    """A model made ready for evaluation."""

    model: Model
    canonical: Floats  # [N, 3] the anchors at rest: riders where their group is at its reference
    levels: tuple[Level, ...]  # empty for a static model
    weights: TimeNetwork | None  # Phi_w, the scores of ACFA; None where the planes are not weighted
    offset: TimeNetwork | None  # Phi_o of DLGD; None when DLGD is off
    scale: TimeNetwork | None  # Phi_s of DLGD


class Mixed(Protocol):
    """The networks of time at one time, ready made (`knots`); None of what is to be asked of the network itself."""

    def shares_of(self, part: slice) -> Floats | None:
        """The shares of the planes [6, n, C] of a slice of the anchors."""

    def offset_of(self, part: slice) -> Floats | None:
        """Phi_o [n, 3 K]."""

    def scale_of(self, part: slice) -> Floats | None:
        """Phi_s [n, 6]."""


@dataclass(frozen=True)
class AnchorState:
    """The anchors at one time, those of a group in its frame, the others in the model's."""

    poses: Poses | None  # where the groups are then
    positions: Floats  # [N, 3]
    features: Floats  # [N, F]
    offsets: Floats  # [N, K, 3]
    scales: Floats  # [N, 6]


@dataclass(frozen=True)
class LocalGaussians:
    """The decoded local Gaussians of every anchor, in world metres; riders have been moved with their group."""

    positions: Floats  # [N, K, 3]
    colors: Floats  # [N, K, 3] sRGB
    opacities: Floats  # [N, K] in (-1, 1); not drawn where not positive
    scales: Floats  # [N, K, 3] standard deviations
    quaternions: Floats  # [N, K, 4] w x y z


def prepare(model: Model) -> Field:
    """Compute everything about a model that does not depend on the time (steps 1 and 2, and shares of 3 and 5).

    Raises:
        ModelFileError: that would take memory out of all proportion to the file, as only a hostile one does.
    """
    tensors = model.tensors
    canonical = tensors["anchors.position"]
    if model.groups is not None:
        canonical = in_model_frame(model, model.groups.at_reference(), canonical, slice(0, len(canonical)))
    if model.static:
        return Field(model, canonical, (), None, None, None)
    _check_memory(model)
    query = _warped(model, canonical)
    levels = []
    for level in range(model.config.levels):
        planes = {
            name: np.ascontiguousarray(tensors[f"field.planes.{level}.{name}"].transpose(1, 2, 0)) for name in PLANES
        }
        spatial = np.stack(
            [
                _bilinear(planes[name], query[:, "xyz".index(name[0])], query[:, "xyz".index(name[1])])
                for name in PLANES[:3]
            ]
        )
        temporal = tuple(
            TemporalPlane(planes[name], *_texels(query[:, axis], planes[name].shape[1]))
            for axis, name in enumerate(PLANES[3:])
        )
        levels.append(Level(spatial, temporal))
    config = model.config
    return Field(
        model,
        canonical,
        tuple(levels),
        _time_network(model, "acfa", *WEIGHTED[config.aggregation]) if config.aggregation in WEIGHTED else None,
        _time_network(model, "dlgd_offset", "embedding_offset", True) if config.dlgd else None,
        _time_network(model, "dlgd_scale", "embedding_scale", True) if config.dlgd else None,
    )


def anchor_state(field: Field, t: float, *, offsets: bool = True, mixed: Mixed | None = None) -> AnchorState:
    """The anchors at any real time t (steps 1 to 5); outside [0, 1] the planes hold their border's value.

    Without `offsets` those stay canonical: who shows anchors alone does not need them. `mixed` stands for the networks
    of time.
    """
    model = field.model
    names = ("position", "feature", "offset", "log_scale")
    positions, features, spread, log_scales = (model.tensors[f"anchors.{name}"] for name in names)
    encoded = _Encoded(field, t, mixed) if field.levels else None
    if encoded is not None:
        positions, features = positions.copy(), features.copy()
        hidden = _joined(model, ("head_position.hidden", "head_feature.hidden"))
        width = len(model.tensors["head_position.hidden.bias"])
    if field.scale is not None:
        spread, log_scales = spread.copy() if offsets else spread, log_scales.copy()

    def move(part: slice) -> None:
        if encoded is not None:
            both = _relu(_output(encoded.at(part), *hidden))
            positions[part] += _output(both[:, :width], *_layer(model, "head_position.output"))
            features[part] += _output(both[:, width:], *_layer(model, "head_feature.output"))
        if field.offset is not None and offsets:
            added = None if mixed is None else mixed.offset_of(part)
            spread[part] += (field.offset(t, part) if added is None else added).reshape(-1, *spread.shape[1:])
        if field.scale is not None:
            added = None if mixed is None else mixed.scale_of(part)
            log_scales[part] += field.scale(t, part) if added is None else added

        np.exp(log_scales[part], out=scales[part])

    scales = np.empty_like(log_scales)
    over_chunks(len(positions), move)
    return AnchorState(_poses(model, t), positions, features, spread, scales)


def anchor_positions(field: Field, t: float) -> Floats:
    """The anchors' places [N, 3] alone, in the model's frame: riders have been moved with their group."""
    model = field.model
    positions = model.tensors["anchors.position"]
    if field.levels:
        encoded = _Encoded(field, t)
        positions = positions + _gathered(len(positions), lambda part: _mlp(model, "head_position", encoded.at(part)))
    return in_model_frame(model, _poses(model, t), positions, slice(0, len(positions)))


def centers(field: Field, state: AnchorState) -> Floats:
    """The anchors' places [N, 3] of `anchor_state`, in the model's frame."""
    return in_model_frame(field.model, state.poses, state.positions, slice(0, len(state.positions)))


def presence(field: Field, state: AnchorState) -> Floats:
    """The share [N] of its opacity that each anchor has then: of a group that has not come yet, none."""
    groups = field.model.groups
    shares = np.ones(field.model.anchor_count, np.float32)
    if groups is not None and state.poses is not None:
        shares[groups.riders] = state.poses.presence[groups.of_anchor[groups.riders]]
    return shares


def in_model_frame(model: Model, poses: Poses | None, points: Floats, part: slice) -> Floats:
    """Points [n, ..., 3] of a slice of the anchors, each in its anchor's frame, in the model's frame."""
    if model.groups is None or poses is None:
        return points
    rows, group = model.groups.within(part)
    if not len(rows):
        return points
    moved = points.copy()
    moved[rows] = poses.to_world(group, points[rows])
    return moved


def plane_weights(field: Field, t: float) -> Floats:
    """The share [N, 6] that each plane has in the features of each anchor at time t, mean over the channels.

    Where the planes are not weighted, and in a static model, each has a sixth.
    """
    count, network = field.model.anchor_count, field.weights
    if network is None:
        return np.full((count, len(PLANES)), 1 / len(PLANES), np.float32)

    def shares(part: slice) -> Floats:
        odds, total = _odds(network, t, part)
        share = (odds / total).mean(axis=2).T
        return np.broadcast_to(share, (len(range(*part.indices(count))), len(PLANES)))

    return _gathered(count, shares)


def local_gaussians(field: Field, state: AnchorState, camera_center: Doubles) -> LocalGaussians:
    """Decode the local Gaussians as a camera at `camera_center` [3] (world metres) sees them (step 6)."""
    model = field.model
    K = model.config.offsets
    decoder = _Decoder(model, state, camera_center)
    share = presence(field, state)

    def decode(part: slice) -> tuple[Floats, ...]:
        colors, opacities, hidden = decoder.at(part)
        opacities *= share[part, None]
        covariance = _output(hidden, *_layer(model, "decoder_covariance.output")).reshape(-1, K, 7)
        sizes = state.scales[part, None]
        scales = np.float32(model.scale) * sizes[..., 3:] * _sigmoid(covariance[..., :3])
        quaternions = covariance[..., 3:]
        quaternions = quaternions / np.maximum(np.linalg.norm(quaternions, axis=-1, keepdims=True), np.float32(1e-12))
        positions = state.positions[part, None] + state.offsets[part] * sizes[..., :3]
        positions = to_world(model, in_model_frame(model, state.poses, positions, part))
        if model.groups is not None and state.poses is not None:
            rows, group = model.groups.within(part)
            quaternions[rows] = state.poses.turn(group, quaternions[rows])
        return positions, colors, opacities, scales, quaternions

    return LocalGaussians(*_columns(over_chunks(len(state.positions), decode)))


def anchor_appearance(
    field: Field, state: AnchorState, camera_center: Doubles
) -> tuple[Floats, Floats, Floats]:  # sRGB [N, K, 3], opacities [N, K], reach [N, K]
    """Of `local_gaussians` what one point an anchor needs, without places and rotations: colours, opacities, and the
    reach of each, the geometric mean of its two largest standard deviations in metres. Opacities are those of a group
    that is wholly there."""
    model = field.model
    K = model.config.offsets
    rows = np.arange(7 * K).reshape(K, 7)[:, :3].ravel(order="F")  # all first axes, all second, all third
    weight, bias = (values[rows] for values in _layer(model, "decoder_covariance.output"))
    decoder = _Decoder(model, state, camera_center)

    def decode(part: slice) -> tuple[Floats, ...]:
        colors, opacities, hidden = decoder.at(part)
        shares = _sigmoid(_output(hidden, weight, bias)).reshape(-1, 3, K)
        first, second, third = (state.scales[part, 3 + axis, None] * shares[:, axis] for axis in range(3))
        most = np.maximum(np.maximum(first, second), third)
        middle = np.maximum(np.minimum(first, second), np.minimum(np.maximum(first, second), third))
        return colors, opacities, np.float32(model.scale) * np.sqrt(most * middle)

    colors, opacities, reach = _columns(over_chunks(len(state.positions), decode))
    return colors, opacities, reach


def appearance_from(
    field: Field, state: AnchorState, eyes: Doubles
) -> Callable[[slice], tuple[Floats, Floats]]:  # sRGB [n, K, E, 3], opacities [n, K, E]
    """What each eye [E, 3] (world metres) sees of a slice of the anchors: colours and opacities of their Gaussians."""
    decoders = [_Decoder(field.model, state, eye) for eye in eyes]
    share = presence(field, state)

    def seen(part: slice) -> tuple[Floats, Floats]:
        looks = [decoder.at(part)[:2] for decoder in decoders]
        opacities = np.maximum(np.stack([opacity for _, opacity in looks], axis=2), 0)
        return np.stack([color for color, _ in looks], axis=2), opacities * share[part, None, None]

    return seen


def to_world(model: Model, positions: Floats) -> Floats:
    """Positions [..., 3] of the model frame in world metres."""
    return (model.scale * positions.astype(np.float64) + model.translation).astype(np.float32)


def _check_memory(model: Model) -> None:
    hidden = sum(len(tensor) for name, tensor in model.tensors.items() if name.endswith(TIME_NETWORK_BIASES))
    needed = 4 * model.anchor_count * (3 * model.config.plane_dim * model.config.levels + hidden)
    if needed > max(2**30, MEMORY_RATIO * sum(tensor.nbytes for tensor in model.tensors.values())):
        raise ModelFileError(
            f"{model.path.name} would need {needed / 2**30:.0f} GiB to evaluate, out of proportion to its size."
        )


def _gathered(count: int, work: Callable[[slice], Floats]) -> Floats:
    """The rows that `work` makes of each slice of the anchors, as one array."""
    return np.concatenate(over_chunks(count, work))


def _columns(parts: Iterable[tuple[Floats, ...]]) -> list[Floats]:
    """Of several arrays for each slice, each as one array."""
    return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]


def _layer(model: Model, name: str) -> tuple[Floats, Floats]:
    """Weight [outputs, inputs] and bias [outputs]."""
    return model.tensors[f"{name}.weight"], model.tensors[f"{name}.bias"]


def _joined(model: Model, layers: Iterable[str]) -> tuple[Floats, Floats]:
    """Layers of the same inputs as one, their outputs side by side: one product instead of several."""
    weights, biases = zip(*(_layer(model, name) for name in layers), strict=True)
    return np.concatenate(weights), np.concatenate(biases)


def _output(x: Floats, weight: Floats, bias: Floats) -> Floats:
    """weight x + bias for each row of x [n, inputs]: [n, outputs]."""
    y = product(x, weight)
    y += bias
    return y


def _relu(x: Floats) -> Floats:
    """In place."""
    return np.maximum(x, 0, out=x)


def _mlp(model: Model, name: str, x: Floats) -> Floats:
    return _output(_relu(_output(x, *_layer(model, f"{name}.hidden"))), *_layer(model, f"{name}.output"))


def _sigmoid(x: Floats) -> Floats:
    return np.float32(0.5) * (1 + np.tanh(np.float32(0.5) * x))  # the form that cannot overflow


def _time_network(model: Model, name: str, embedding: str | None, timed: bool) -> TimeNetwork:
    """The network whose hidden layer sees the embedding, or not, and then the time, or not."""
    weight = model.tensors[f"{name}.hidden.weight"]
    seen = weight[:, : weight.shape[1] - timed]
    static = model.tensors[f"{name}.hidden.bias"][None]
    if embedding is not None:
        static = model.tensors[f"anchors.{embedding}"] @ seen.T + static
    time = weight[:, -1].copy() if timed else np.zeros(len(weight), np.float32)
    return TimeNetwork(static, time, *_layer(model, f"{name}.output"))


def _poses(model: Model, t: float) -> Poses | None:
    """Where the groups are at t; in a static model at their reference at all times."""
    if model.groups is None:
        return None
    return model.groups.at_reference() if model.static else model.groups.at(t)


def _warped(model: Model, canonical: Floats) -> Floats:
    """Step 1: the anchors [N, 3] in the field's box, [-1, 1], through DACW: [N, 3]."""
    lower, upper = model.tensors["field.box"]
    boundaries = model.tensors["warp.boundaries"]
    uniform = np.linspace(-1, 1, boundaries.shape[1])
    flat = np.float32(1) * (upper == lower)  # an axis without extent counts as one unit more to both sides
    u = np.clip(2 * (canonical - (lower - flat)) / (upper - lower + 2 * flat) - 1, -1, 1)
    return np.stack([np.interp(u[:, axis], uniform, boundaries[axis]) for axis in range(3)], axis=1).astype(np.float32)


def _texels(coordinate: Floats, resolution: int) -> tuple[Indices, Floats]:
    """The texel left of each coordinate in [-1, 1] and the fraction [N, 1] of the way to the next (align_corners)."""
    place = np.clip((coordinate + 1) * np.float32(0.5 * (resolution - 1)), 0, resolution - 1)
    left = np.minimum(place.astype(np.intp), max(resolution - 2, 0))
    return left, (place - left.astype(np.float32))[:, None]


def _bilinear(plane: Floats, x: Floats, y: Floats) -> Floats:
    """Interpolate plane [R2, R1, C] at x along R1 and y along R2, both in [-1, 1]: [N, C]."""
    (left, right_share), (top, bottom_share) = _texels(x, plane.shape[1]), _texels(y, plane.shape[0])
    right, bottom = np.minimum(left + 1, plane.shape[1] - 1), np.minimum(top + 1, plane.shape[0] - 1)
    upper = plane[top, left] + right_share * (plane[top, right] - plane[top, left])
    lower = plane[bottom, left] + right_share * (plane[bottom, right] - plane[bottom, left])
    return upper + bottom_share * (lower - upper)


def _row_at(rows: Floats, t: float) -> Floats:
    """The row [R1, C] of a temporal plane [R2, R1, C] at time t."""
    place = min(max(t, 0.0), 1.0) * (len(rows) - 1)
    low = min(int(place), max(len(rows) - 2, 0))
    return rows[low] + np.float32(place - low) * (rows[min(low + 1, len(rows) - 1)] - rows[low])


def _odds(network: TimeNetwork, t: float, part: slice) -> tuple[Floats, Floats]:
    """w_p(t) times their sum over the planes, [6, n, C], and that sum [n, C]; n is 1 where all anchors share them."""
    scores = network(t, part)
    odds = np.ascontiguousarray(scores.reshape(len(scores), len(PLANES), -1).transpose(1, 0, 2))
    odds -= odds.max(axis=0)
    np.exp(odds, out=odds)
    return odds, odds.sum(axis=0)


class _Encoded:
    """Steps 1 to 3 and the encoder of step 4 at one time."""

    def __init__(self, field: Field, t: float, mixed: Mixed | None = None) -> None:
        self.field, self.t, self.mixed = field, t, mixed
        self.rows = []  # of each level's temporal planes: the row at t, and the way from each texel to the next
        for level in field.levels:
            rows = [_row_at(plane.rows, t) for plane in level.temporal]
            self.rows.append([(row, np.diff(row, axis=0, append=row[-1:])) for row in rows])

    def at(self, part: slice) -> Floats:
        """relu(z) [n, width] of a slice of the anchors."""
        return _relu(_output(self._aggregate(part), *_layer(self.field.model, "encoder")))

    def _aggregate(self, part: slice) -> Floats:
        """The six planes' features as one, levels concatenated: [n, L * C]."""
        field = self.field
        odds, total = (None if self.mixed is None else self.mixed.shares_of(part)), None
        if odds is None and field.weights is not None:
            odds, total = _odds(field.weights, self.t, part)
        features = []
        for level, rows in zip(field.levels, self.rows, strict=True):
            planes = list(level.spatial[:, part])
            for plane, (row, step) in zip(level.temporal, rows, strict=True):
                left = plane.left[part]
                sample = step.take(left, axis=0)
                sample *= plane.fraction[part]
                sample += row.take(left, axis=0)
                planes.append(sample)
            feature = planes[0].copy() if odds is None else odds[0] * planes[0]
            for index in range(1, len(PLANES)):
                if odds is not None:
                    feature += odds[index] * planes[index]
                elif field.model.config.aggregation == "product":
                    feature *= planes[index]
                else:  # mean
                    feature += planes[index]
            if total is not None:
                feature /= total
            elif field.model.config.aggregation == "mean":
                feature /= np.float32(len(PLANES))
            features.append(feature)
        return np.concatenate(features, axis=1)


class _Decoder:
    """What the three decoders share: their inputs [f_i(t), d], and hidden layers computed as one."""

    NAMES = ("decoder_color", "decoder_opacity", "decoder_covariance")

    def __init__(self, model: Model, state: AnchorState, camera_center: Doubles) -> None:
        self.model, self.state = model, state
        center = (camera_center - model.translation) / model.scale
        self.center = np.broadcast_to(center.astype(np.float32), state.positions.shape)
        if model.groups is not None and state.poses is not None:  # riders are seen from within their group's frame
            riders = model.groups.riders
            self.center = self.center.copy()
            self.center[riders] = state.poses.to_group(model.groups.of_anchor[riders], center)
        self.hidden = _joined(model, (f"{name}.hidden" for name in self.NAMES))
        self.ends = np.cumsum([len(model.tensors[f"{name}.hidden.bias"]) for name in self.NAMES])

    def at(self, part: slice) -> tuple[Floats, Floats, Floats]:
        """Of a slice of the anchors: colours [n, K, 3], opacities [n, K], the covariance's hidden layer [n, width]."""
        direction = self.state.positions[part] - self.center[part]
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), np.float32(1e-12))
        hidden = _relu(_output(np.concatenate([self.state.features[part], direction], axis=1), *self.hidden))
        color, opacity, covariance = np.split(hidden, self.ends[:-1], axis=1)
        colors = _sigmoid(_output(color, *_layer(self.model, "decoder_color.output")))
        opacities = np.tanh(_output(opacity, *_layer(self.model, "decoder_opacity.output")))
        return colors.reshape(len(colors), -1, 3), opacities, covariance

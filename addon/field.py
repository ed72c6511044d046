"""Evaluating a model at any time with numpy (docs/formats.md, "Evaluating a model at time t").

What does not depend on the time is computed once, in `prepare`: the spatial planes at every anchor, where each anchor
falls on the temporal planes, and the embedding's share of the first layers. A time then costs one interpolation between
two rows of each temporal plane, a gather, and the small networks.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .container import Floats, ModelFileError
from .model import PLANES, WEIGHTED, Doubles, Model

Indices = npt.NDArray[np.intp]

CHUNK = 1024  # anchors at a time: the temporaries of one chunk stay in the processor's cache
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

    spatial: Floats  # [N, 3, C]: xy, xz, yz at the anchors
    temporal: tuple[TemporalPlane, ...]  # xt, yt, zt


@dataclass(frozen=True)
class TimeNetwork:
    """output(relu(hidden([embedding, t]))) with the embedding's share of the hidden layer already summed."""

    static: Floats  # [N, H], or [1, H] where there is no embedding: the same for every anchor
    time: Floats  # [H]
    weight: Floats  # [H, outputs]
    bias: Floats  # [outputs]

    def __call__(self, t: float, part: slice) -> Floats:
        """Evaluate at t for a slice of the anchors: [n, outputs] or [1, outputs]."""
        static = self.static[part] if len(self.static) > 1 else self.static
        hidden = static + np.float32(t) * self.time
        return np.maximum(hidden, 0, out=hidden) @ self.weight + self.bias


@dataclass(frozen=True)
class Field:
    """A model made ready for evaluation."""

    model: Model
    levels: tuple[Level, ...]  # empty for a static model
    weights: TimeNetwork | None  # Phi_w, the scores of ACFA; None where the planes are not weighted
    offset: TimeNetwork | None  # Phi_o of DLGD; None when DLGD is off
    scale: TimeNetwork | None  # Phi_s of DLGD


@dataclass(frozen=True)
class AnchorState:
    """The anchors at one time, model frame."""

    positions: Floats  # [N, 3]
    features: Floats  # [N, F]
    offsets: Floats  # [N, K, 3]
    scales: Floats  # [N, 6]


@dataclass(frozen=True)
class LocalGaussians:
    """The decoded local Gaussians of every anchor, in world metres."""

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
    if model.static:
        return Field(model, (), None, None, None)
    _check_memory(model)
    tensors = model.tensors
    query = _warped_positions(model)
    levels = []
    for level in range(model.config.levels):
        planes = {
            name: np.ascontiguousarray(tensors[f"field.planes.{level}.{name}"].transpose(1, 2, 0)) for name in PLANES
        }
        spatial = np.stack(
            [
                _bilinear(planes[name], query[:, "xyz".index(name[0])], query[:, "xyz".index(name[1])])
                for name in PLANES[:3]
            ],
            axis=1,
        )
        temporal = tuple(
            TemporalPlane(planes[name], *_texels(query[:, axis], planes[name].shape[1]))
            for axis, name in enumerate(PLANES[3:])
        )
        levels.append(Level(spatial, temporal))
    config = model.config
    return Field(
        model,
        tuple(levels),
        _time_network(model, "acfa", *WEIGHTED[config.aggregation]) if config.aggregation in WEIGHTED else None,
        _time_network(model, "dlgd_offset", "embedding_offset", True) if config.dlgd else None,
        _time_network(model, "dlgd_scale", "embedding_scale", True) if config.dlgd else None,
    )


def anchor_state(field: Field, t: float, *, offsets: bool = True) -> AnchorState:
    """The anchors at any real time t (steps 1 to 5); outside [0, 1] the planes hold their border's value.

    Without `offsets` those stay canonical: who shows anchors alone does not need them.
    """
    tensors = field.model.tensors
    positions = tensors["anchors.position"]
    features = tensors["anchors.feature"]
    spread = tensors["anchors.offset"]
    log_scales = tensors["anchors.log_scale"]
    if field.levels:
        positions, features = positions.copy(), features.copy()
        for part, hidden in _encoded(field, t):
            positions[part] += _mlp(field.model, "head_position", hidden)
            features[part] += _mlp(field.model, "head_feature", hidden)
    if field.offset is not None and field.scale is not None:
        spread, log_scales = spread.copy() if offsets else spread, log_scales.copy()
        for part in _chunks(len(positions)):
            if offsets:
                spread[part] += field.offset(t, part).reshape(-1, *spread.shape[1:])
            log_scales[part] += field.scale(t, part)
    return AnchorState(positions, features, spread, np.exp(log_scales))


def anchor_positions(field: Field, t: float) -> Floats:
    """The centres [N, 3] of `anchor_state` alone, model frame."""
    positions = field.model.tensors["anchors.position"]
    if field.levels:
        positions = positions.copy()
        for part, hidden in _encoded(field, t):
            positions[part] += _mlp(field.model, "head_position", hidden)
    return positions


def plane_weights(field: Field, t: float) -> Floats:
    """The share [N, 6] that each plane has in the features of each anchor at time t, mean over the channels.

    Where the planes are not weighted, and in a static model, each has a sixth.
    """
    shares = np.full((field.model.anchor_count, len(PLANES)), 1 / len(PLANES), np.float32)
    if field.weights is not None:
        for part in _chunks(len(shares)):
            shares[part] = _softmax(field, t, part).mean(axis=2)
    return shares


def local_gaussians(field: Field, state: AnchorState, camera_center: Doubles) -> LocalGaussians:
    """Decode the local Gaussians as a camera at `camera_center` [3] (world metres) sees them (step 6)."""
    model = field.model
    K = model.config.offsets
    parts = []
    for part, inputs in _decoder_inputs(model, state, camera_center):
        covariance = _mlp(model, "decoder_covariance", inputs).reshape(-1, K, 7)
        sizes = state.scales[part, None]
        scales = np.float32(model.scale) * sizes[..., 3:] * _sigmoid(covariance[..., :3])
        quaternions = covariance[..., 3:]
        quaternions = quaternions / np.maximum(np.linalg.norm(quaternions, axis=-1, keepdims=True), np.float32(1e-12))
        positions = to_world(model, state.positions[part, None] + state.offsets[part] * sizes[..., :3])
        parts.append((positions, *_colors_and_opacities(model, inputs), scales, quaternions))
    return LocalGaussians(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def anchor_appearance(
    field: Field, state: AnchorState, camera_center: Doubles
) -> tuple[Floats, Floats, Floats]:  # sRGB [N, K, 3], opacities [N, K], reach [N, K]
    """Of `local_gaussians` what one point an anchor needs, without places and rotations: colours, opacities, and the
    reach of each, the geometric mean of its two largest standard deviations in metres."""
    model = field.model
    K = model.config.offsets
    rows = np.arange(7 * K).reshape(K, 7)[:, :3].ravel(order="F")  # all first axes, all second, all third
    weight = model.tensors["decoder_covariance.output.weight"][rows].T
    bias = model.tensors["decoder_covariance.output.bias"][rows]
    parts = []
    for part, inputs in _decoder_inputs(model, state, camera_center):
        hidden = np.maximum(_linear(model, "decoder_covariance.hidden", inputs), 0)
        shares = _sigmoid(hidden @ weight + bias).reshape(-1, 3, K)
        first, second, third = ((state.scales[part, 3 + axis, None] * shares[:, axis]) for axis in range(3))
        most = np.maximum(np.maximum(first, second), third)
        middle = np.maximum(np.minimum(first, second), np.minimum(np.maximum(first, second), third))
        parts.append((*_colors_and_opacities(model, inputs), np.float32(model.scale) * np.sqrt(most * middle)))
    colors, opacities, reach = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return colors, opacities, reach


def _decoder_inputs(model: Model, state: AnchorState, camera_center: Doubles) -> Iterator[tuple[slice, Floats]]:
    """[f_i(t), d] [n, F + 3] for one slice of the anchors after the other."""
    center = ((camera_center - model.translation) / model.scale).astype(np.float32)
    direction = state.positions - center
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), np.float32(1e-12))
    for part in _chunks(len(direction)):
        yield part, np.concatenate([state.features[part], direction[part]], axis=1)


def _colors_and_opacities(model: Model, inputs: Floats) -> tuple[Floats, Floats]:
    colors = _sigmoid(_mlp(model, "decoder_color", inputs)).reshape(-1, model.config.offsets, 3)
    return colors, np.tanh(_mlp(model, "decoder_opacity", inputs))


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


def _chunks(count: int) -> Iterator[slice]:
    return (slice(start, start + CHUNK) for start in range(0, count, CHUNK))


def _linear(model: Model, name: str, x: Floats) -> Floats:
    return x @ model.tensors[f"{name}.weight"].T + model.tensors[f"{name}.bias"]


def _mlp(model: Model, name: str, x: Floats) -> Floats:
    return _linear(model, f"{name}.output", np.maximum(_linear(model, f"{name}.hidden", x), 0))


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
    output = np.ascontiguousarray(model.tensors[f"{name}.output.weight"].T)
    return TimeNetwork(static, time, output, model.tensors[f"{name}.output.bias"])


def _warped_positions(model: Model) -> Floats:
    """Step 1: the anchors in the field's box, [-1, 1], through DACW: [N, 3]."""
    lower, upper = model.tensors["field.box"]
    boundaries = model.tensors["warp.boundaries"]
    uniform = np.linspace(-1, 1, boundaries.shape[1])
    u = np.clip(2 * (model.tensors["anchors.position"] - lower) / (upper - lower) - 1, -1, 1)
    return np.stack([np.interp(u[:, axis], uniform, boundaries[axis]) for axis in range(3)], axis=1).astype(np.float32)


def _texels(coordinate: Floats, resolution: int) -> tuple[Indices, Floats]:
    """The texel left of each coordinate in [-1, 1] and the fraction [N, 1] of the way to the next (align_corners)."""
    place = np.clip((coordinate + 1) * np.float32(0.5 * (resolution - 1)), 0, resolution - 1)
    left = np.minimum(place.astype(np.intp), max(resolution - 2, 0))
    return left, (place - left.astype(np.float32))[:, None]


def _between(row: Floats, left: Indices, fraction: Floats) -> Floats:
    """Linear interpolation along the first axis of `row` [R, C]: [n, C]."""
    near = row[left]
    return near + fraction * (row[np.minimum(left + 1, len(row) - 1)] - near)


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


def _encoded(field: Field, t: float) -> Iterator[tuple[slice, Floats]]:
    """Steps 1 to 3 and the encoder of step 4: relu(z) [n, width] for one slice of the anchors after the other."""
    rows = [[_row_at(plane.rows, t) for plane in level.temporal] for level in field.levels]
    for part in _chunks(field.model.anchor_count):
        yield part, np.maximum(_linear(field.model, "encoder", _aggregate(field, rows, t, part)), 0)


def _softmax(field: Field, t: float, part: slice) -> Floats:
    """w_p(t) over the planes, for each channel: [n, 6, C], or [1, 6, C] where all anchors have the same."""
    assert field.weights is not None
    scores = field.weights(t, part).reshape(-1, len(PLANES), field.model.config.plane_dim)
    scores -= scores.max(axis=1, keepdims=True)
    weights: Floats = np.exp(scores, out=scores)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights


def _aggregate(field: Field, rows: list[list[Floats]], t: float, part: slice) -> Floats:
    """Steps 2 and 3: the six planes' features as one, levels concatenated: [n, L * C]."""
    weights = None if field.weights is None else _softmax(field, t, part)
    features = []
    for level, level_rows in zip(field.levels, rows, strict=True):
        temporal = [
            _between(row, plane.left[part], plane.fraction[part])
            for plane, row in zip(level.temporal, level_rows, strict=True)
        ]
        spatial = level.spatial[part]
        if weights is not None:
            feature = (weights[:, :3] * spatial).sum(axis=1)
            for index, sample in enumerate(temporal, start=3):
                feature += weights[:, index] * sample
        elif field.model.config.aggregation == "product":
            feature = spatial.prod(axis=1) * temporal[0] * temporal[1] * temporal[2]
        else:  # mean
            feature = (spatial.sum(axis=1) + temporal[0] + temporal[1] + temporal[2]) / np.float32(len(PLANES))
        features.append(feature)
    return np.concatenate(features, axis=1)

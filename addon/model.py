"""The model file: its metadata and tensors, checked (docs/formats.md, "The model file", versions 1 and 2)."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .clip import Clip, read_clip
from .container import Entry, Floats, ModelFileError, read_header, read_tensors
from .groups import FEWEST_CONTROLS, Groups
from .header import (
    FARTHEST_MODEL_M,
    LONGEST_NAME,
    Doubles,
    array,
    integer,
    number,
    require,
)
from .names import PLANES

VERSION = 2  # the newest that is read
METHOD = "adaanchor4d"
GROUPED = 2  # the first whose anchors ride on groups
# What Phi_w sees in each aggregation that has weights: an embedding of the anchors, and whether the time.
WEIGHTED: dict[str, tuple[str | None, bool]] = {
    "acfa": ("embedding_acfa", True),
    "anchor_only": ("embedding_acfa", False),
    "time_only": (None, True),
}
AGGREGATIONS = (*WEIGHTED, "mean", "product")
# docs/formats.md, "What readers refuse": the limits that aa4d holds as well.
SMALLEST_UNIT_M, LARGEST_UNIT_M = 1e-6, 1e6  # of the scale in `model_to_world`
WIDEST = 4096  # of a layer, and the largest size in `config`: the default layers are at most 256 wide
UNIT_TOLERANCE = 1e-3  # of the length of `groups.up`
UNIFORM_TOLERANCE = 1e-6  # of boundaries without DACW


@dataclass(frozen=True)
class Config:
    """The sizes and switches under `config` in the file's metadata."""

    offsets: int
    feature_dim: int
    embedding_dim: int
    plane_dim: int
    levels: int
    bins: int
    aggregation: str
    dlgd: bool
    dacw: bool


@dataclass(frozen=True)
class Model(Clip):
    """A model file in memory, checked."""

    static: bool  # a coarse file: the canonical anchors hold at every time
    config: Config
    scale: float  # world = scale * model + translation
    translation: Doubles  # [3], metres
    tensors: Mapping[str, Floats]
    groups: Groups | None  # what anchors ride on; their positions are then in their group's frame

    @property
    def anchor_count(self) -> int:
        """N, the number of anchors."""
        return len(self.tensors["anchors.position"])


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read and check a model file.

    Raises:
        ModelFileError: the file is missing, cut short, malformed, newer than this reader, or holds unusable values.
    """
    path = Path(path)
    header = read_header(path)
    try:
        information = json.loads(header.metadata["aa4d"])
        if information["format"] != "aa4d-model":
            raise KeyError("format")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ModelFileError(
            f"{path.name} is a safetensors file but not an AdaAnchor4D model: its aa4d metadata is missing or damaged."
        ) from error
    version = information.get("version")
    if type(version) is not int or version < 1:
        raise ModelFileError(f"{path.name} has no usable version number in its aa4d metadata.")
    if version > VERSION and isinstance(method := information.get("method"), str) and method != METHOD:
        raise ModelFileError(
            f"{path.name} is a model of {method[:40]!r}, and this add-on draws {METHOD} alone; export its track file "
            "with aa4d export --format track."
        )
    if version > VERSION:
        raise ModelFileError(
            f"{path.name} is a model file of version {version}, newer than version {VERSION} that this add-on reads; "
            "update the add-on."
        )
    try:
        require(information.get("method", METHOD) == METHOD, f"method must be {METHOD} before version {VERSION + 1}")
        static = {"coarse": True, "fine": False}[information["stage"]]
        config = _config(information["config"])
        scale, translation = _similarity(information["model_to_world"])
        clip = read_clip(path, information)
        require(number(information["training"]["seconds"], "training.seconds") >= 0, "training.seconds is negative")
        group_names = _group_names(information["groups"]) if version >= GROUPED else None
        require(group_names is not None or "anchors.group" not in header.entries, "version 1 knows no groups")
    except KeyError as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata lacks or misspells {error}.") from error
    except (TypeError, AttributeError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not laid out as docs/formats.md says.") from error
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f"{path.name}: its aa4d metadata is not usable: {error}.") from error
    tensors = read_tensors(path, header.entries, _check_shapes(path.name, header.entries, config, group_names))
    groups = None if group_names is None else _groups(path.name, tensors, group_names)
    _check_values(path.name, tensors, groups, config, scale, translation)
    return Model(
        **vars(clip),
        static=static,
        config=config,
        scale=scale,
        translation=translation,
        tensors=tensors,
        groups=groups,
    )


def _config(value: Any) -> Config:
    aggregation = value.get("aggregation", "acfa")
    require(
        aggregation in AGGREGATIONS,
        f"aggregation {aggregation!r} is unknown; this add-on knows {', '.join(AGGREGATIONS)}",
    )
    switches = {name: value.get(name, True) for name in ("dlgd", "dacw")}
    for name, switch in switches.items():
        require(type(switch) is bool, f"config.{name} must be true or false")
    names = ("offsets", "feature_dim", "embedding_dim", "plane_dim", "levels", "bins")
    sizes = {name: integer(value[name], f"config.{name}", WIDEST) for name in names}
    return Config(**sizes, aggregation=aggregation, dlgd=switches["dlgd"], dacw=switches["dacw"])


def _similarity(value: Any) -> tuple[float, Doubles]:
    matrix = array(value, (4, 4), "model_to_world")
    scale = matrix[0, 0]
    expected = np.diag([scale, scale, scale, 1.0])
    expected[:3, 3] = matrix[:3, 3]
    require(
        SMALLEST_UNIT_M <= scale <= LARGEST_UNIT_M and np.array_equal(matrix, expected),
        f"model_to_world must be a uniform scale of {SMALLEST_UNIT_M:g} to {LARGEST_UNIT_M:g} and a translation",
    )
    return float(scale), matrix[:3, 3]


def _group_names(value: Any) -> tuple[str, ...]:
    require(isinstance(value, list), "groups must be a list")
    group_names = tuple(group["name"] for group in value)
    for row, name in enumerate(group_names):
        require(
            isinstance(name, str) and len(name) <= LONGEST_NAME,
            f"the name of group {row} must be a text of at most {LONGEST_NAME} characters",
        )
    return group_names


def _groups(file_name: str, tensors: Mapping[str, Floats], group_names: tuple[str, ...]) -> Groups:
    """Raises ModelFileError: an anchor of a group that is not there, times that go back, an axis that is not unit."""
    member = tensors["anchors.group"]
    count = len(group_names)
    if not ((member == np.round(member)) & (member >= -1) & (member < count)).all():
        raise ModelFileError(f"{file_name}: anchors.group names a group that is not there; the file has {count}.")
    shown, up = tensors["groups.shown"].astype(np.float64), tensors["groups.up"].astype(np.float64)
    if (np.diff(shown, axis=1) < 0).any():
        raise ModelFileError(f"{file_name}: groups.shown must hold four times that do not decrease.")
    length = float(np.linalg.norm(up))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise ModelFileError(f"{file_name}: groups.up must have length 1, not {length:.3g}.")
    control = np.concatenate([tensors["groups.position"], tensors["groups.heading"][..., None]], axis=2)
    of_anchor = member.astype(np.intp)
    return Groups(
        names=group_names,
        control=control.astype(np.float64),
        reference=tensors["groups.reference"].astype(np.float64),
        shown=shown,
        up=up / length,
        of_anchor=of_anchor,
        riders=np.flatnonzero(of_anchor >= 0),
    )


def _check_shapes(
    file_name: str,
    entries: Mapping[str, Entry],
    config: Config,
    group_names: tuple[str, ...] | None,
) -> list[str]:
    """Check presence and shape of every tensor of a model; return their names."""

    def shape_of(name: str) -> tuple[int, ...]:
        if name not in entries:
            raise ModelFileError(f"{file_name} lacks the tensor {name}; write the model again.")
        return entries[name].shape

    def expect(name: str, *shape: int) -> str:
        if shape_of(name) != shape:
            raise ModelFileError(
                f"{file_name}: tensor {name} has shape {list(shape_of(name))}, its configuration needs {list(shape)}."
            )
        return name

    def layer(name: str, outputs: int | None, inputs: int) -> int:
        """Expect a linear layer; `outputs` None leaves its width to the file. Returns the width."""
        width = outputs if outputs is not None else next(iter(shape_of(f"{name}.weight")), 0)
        if outputs is None and width > WIDEST:
            raise ModelFileError(f"{file_name}: layer {name} is {width} wide; at most {WIDEST} is read.")
        names.extend((expect(f"{name}.weight", width, inputs), expect(f"{name}.bias", width)))
        return width

    def network(name: str, outputs: int, inputs: int, hidden: int | None = None) -> int:
        width = layer(f"{name}.hidden", hidden, inputs)
        layer(f"{name}.output", outputs, width)
        return width

    names: list[str] = []
    count = next(iter(shape_of("anchors.position")), 0)
    if count == 0:
        raise ModelFileError(f"{file_name} holds no anchors; train the model again.")
    K, F, E = config.offsets, config.feature_dim, config.embedding_dim
    names.append(expect("anchors.position", count, 3))
    names.append(expect("anchors.feature", count, F))
    names.append(expect("anchors.offset", count, K, 3))
    names.append(expect("anchors.log_scale", count, 6))
    names.append(expect("anchors.embedding_acfa", count, E))
    width = network("decoder_opacity", K, F + 3)
    network("decoder_color", 3 * K, F + 3, width)
    network("decoder_covariance", 7 * K, F + 3, width)
    if group_names is not None:
        G, shape = len(group_names), shape_of("groups.position")
        if len(shape) != 3 or shape[0] != G or shape[1] < FEWEST_CONTROLS or shape[2] != 3:
            raise ModelFileError(
                f"{file_name}: tensor groups.position has shape {list(shape)}, not [{G}, C, 3] with C of at least "
                f"{FEWEST_CONTROLS}."
            )
        names.append(expect("anchors.group", count))
        names.append(expect("groups.position", *shape))
        names.append(expect("groups.heading", G, shape[1]))
        names.append(expect("groups.start", G, shape[1], 4))
        names.append(expect("groups.reference", G, 4))
        names.append(expect("groups.shown", G, 4))
        names.append(expect("groups.up", 3))
    names.append(expect("field.box", 2, 3))
    names.append(expect("warp.boundaries", 3, config.bins + 1))
    for level in range(config.levels):
        # One resolution a level, and one of time for all: those of the level's, and of the first, plane xt.
        shape, first = shape_of(f"field.planes.{level}.xt"), shape_of("field.planes.0.xt")
        if len(shape) != 3 or shape[0] != config.plane_dim or min(shape) < 1:
            raise ModelFileError(
                f"{file_name}: tensor field.planes.{level}.xt has shape {list(shape)}, not [{config.plane_dim}, rows, "
                "columns]."
            )
        for plane in PLANES:
            rows = first[1] if plane[1] == "t" else shape[2]
            names.append(expect(f"field.planes.{level}.{plane}", config.plane_dim, rows, shape[2]))
    if config.aggregation in WEIGHTED:
        embedding, timed = WEIGHTED[config.aggregation]
        network("acfa", len(PLANES) * config.plane_dim, (E if embedding is not None else 0) + timed)
    width = layer("encoder", None, config.levels * config.plane_dim)
    network("head_position", 3, width, width)
    network("head_feature", F, width, width)
    if config.dlgd:
        names.append(expect("anchors.embedding_offset", count, E))
        names.append(expect("anchors.embedding_scale", count, E))
        network("dlgd_offset", 3 * K, E + 1, network("dlgd_scale", 6, E + 1))
    return names


def _check_values(
    file_name: str,
    tensors: Mapping[str, Floats],
    groups: Groups | None,
    config: Config,
    scale: float,
    translation: Doubles,
) -> None:
    places = {"an anchor": tensors["anchors.position"].astype(np.float64)}
    if groups is not None:
        riders, places["a group"] = (
            groups.riders,
            np.concatenate([groups.control[..., :3].reshape(-1, 3), groups.reference[:, :3]]),
        )
        if len(riders):
            member = groups.of_anchor[riders]
            places["an anchor"][riders] = groups.at_reference().to_world(member, tensors["anchors.position"][riders])
    for what, points in places.items():
        farthest = float(np.abs(scale * points + translation).max(initial=0))
        if not farthest <= FARTHEST_MODEL_M:
            raise ModelFileError(
                f"{file_name} places {what} {farthest:.3g} m from the origin; a world is local, within "
                f"{FARTHEST_MODEL_M:g} m."
            )
    box, boundaries = tensors["field.box"], tensors["warp.boundaries"]
    if not (box[1] >= box[0]).all():
        raise ModelFileError(f"{file_name}: field.box must not have its upper corner below its lower corner.")
    if (np.diff(boundaries, axis=1) < 0).any():
        raise ModelFileError(f"{file_name}: warp.boundaries must not decrease along an axis.")
    if not config.dacw and np.abs(boundaries - np.linspace(-1, 1, config.bins + 1)).max() > UNIFORM_TOLERANCE:
        raise ModelFileError(f"{file_name} says dacw false, but its warp.boundaries are not uniform.")

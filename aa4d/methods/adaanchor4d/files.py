"""AdaAnchor4D's part of the model file: its configuration and its tensors (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import Tensor

from aa4d.errors import InputError
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS
from aa4d.methods.adaanchor4d.model import AdaAnchor4D, blank_model
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.adaanchor4d.warping import CoordinateWarp
from aa4d.methods.tensors import tensor_of

# docs/formats.md, "What readers refuse": the limits that the extension holds as well.
LARGEST_SIZE = 4096  # of what the header's config counts, and of a layer
UNIFORM_TOLERANCE = 1e-6  # of boundaries without DACW


def header(config: ModelConfig) -> dict[str, Any]:
    c = config
    return {
        "offsets": c.offsets,
        "feature_dim": c.feature_dim,
        "embedding_dim": c.embedding_dim,
        "plane_dim": c.plane_dim,
        "levels": len(c.spatial_resolutions),
        "bins": c.bins,
        "aggregation": c.aggregation,
        "dlgd": c.dlgd,
        "dacw": c.dacw,
    }


def blank_of_file(config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> AdaAnchor4D:
    """Raises InputError for a wrong configuration."""
    return blank_model(_config(config, tensors, path), len(tensor_of(tensors, "anchors.position", path)))


def check(model: AdaAnchor4D, path: Path) -> None:
    """Raises InputError where the field's box or DACW's map goes back, or the map contradicts the header."""
    c, boundaries = model.config, model.warp.boundaries
    if (model.field.box[1] < model.field.box[0]).any():
        raise InputError(f"{path}: field.box has its upper corner below its lower corner; train the model again")
    if (boundaries.diff(dim=1) < 0).any():
        raise InputError(f"{path}: warp.boundaries decrease along an axis; train the model again")
    if not c.dacw and (boundaries - CoordinateWarp(c.bins).boundaries).abs().max() > UNIFORM_TOLERANCE:
        raise InputError(f"{path}: the header says dacw false, but warp.boundaries are not uniform; train it again")


def file_name_of(parameter: str) -> str:
    """The tensor's name in the file for a name in the module's state."""
    return parameter.replace("decoder.", "decoder_", 1).replace("aggregation.predictor.", "acfa.", 1)


def _is_plane(parameter: str) -> bool:
    return parameter.startswith("field.planes.")


def as_in_file(parameter: str, value: Tensor) -> Tensor:
    """A plane is [C, R2, R1] in the file, and every tensor is float32."""
    return (value.permute(2, 0, 1) if _is_plane(parameter) else value).float()


def as_in_model(parameter: str, value: Tensor) -> Tensor:
    return value.permute(1, 2, 0) if _is_plane(parameter) and value.dim() == 3 else value


def _config(value: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> ModelConfig:
    """Sizes that the header does not state stand in the tensors' shapes."""
    try:
        for name in ("offsets", "feature_dim", "embedding_dim", "plane_dim", "levels", "bins"):
            # A damaged one must not fill the memory.
            if type(value[name]) is not int or not 1 <= value[name] <= LARGEST_SIZE:
                raise ValueError(f"{name} is {value[name]}")
        aggregation = value.get("aggregation", "acfa")
        if aggregation not in AGGREGATIONS:
            raise InputError(
                f"{path}: aggregation {aggregation!r} is unknown (known: {', '.join(AGGREGATIONS)}); update aa4d"
            )
        dlgd, dacw = _switch(value, "dlgd", path), _switch(value, "dacw", path)
        has_predictor = "acfa.hidden.bias" in tensors
        levels = range(int(value["levels"]))
        planes = [tensor_of(tensors, f"field.planes.{level}.xt", path) for level in levels]
        config = ModelConfig(
            offsets=int(value["offsets"]),
            feature_dim=int(value["feature_dim"]),
            embedding_dim=int(value["embedding_dim"]),
            plane_dim=int(value["plane_dim"]),
            spatial_resolutions=tuple(p.shape[2] for p in planes),
            temporal_resolution=planes[0].shape[1],
            dlgd=dlgd,
            dacw=dacw,
            bins=int(value["bins"]),
            weight_hidden=len(tensors["acfa.hidden.bias"]) if has_predictor else ModelConfig.weight_hidden,
            geometry_hidden=len(tensor_of(tensors, "dlgd_scale.hidden.bias", path))
            if dlgd
            else ModelConfig.geometry_hidden,
            encoder_width=len(tensor_of(tensors, "encoder.bias", path)),
            decoder_hidden=len(tensor_of(tensors, "decoder_opacity.hidden.bias", path)),
            aggregation=aggregation,
        )
        if (
            max(config.weight_hidden, config.geometry_hidden, config.encoder_width, config.decoder_hidden)
            > LARGEST_SIZE
        ):
            raise ValueError(f"a layer is wider than {LARGEST_SIZE}")
        return config
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None


def _switch(config: dict[str, Any], name: str, path: Path) -> bool:
    """A part of the model that can be off; a file that does not say has it."""
    value = config.get(name, True)
    if not isinstance(value, bool):
        raise InputError(f"{path}: config.{name} is {value!r}, expected true or false; train the model again")
    return value

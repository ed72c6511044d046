"""The model file: safetensors with a JSON header (docs/formats.md). Nothing here unpickles."""

from __future__ import annotations

import hashlib
import json
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from aa4d import __version__
from aa4d.capture.frame import ModelFrame
from aa4d.capture.reader import Capture
from aa4d.capture.schema import Frame, PinholeCamera, check_frames, frame_of_index, number_of, pinhole_camera
from aa4d.errors import InputError
from aa4d.field.aggregation import AGGREGATIONS
from aa4d.field.warping import CoordinateWarp
from aa4d.files import whole_file
from aa4d.identity import Identity, digest_of, identity_of
from aa4d.model import AdaAnchor4D, ModelConfig, blank_model
from aa4d.motion.groups import Groups, blank_groups
from aa4d.motion.spline import FEWEST_CONTROLS

MODEL_VERSION = 2  # the newest that is read; what no reader of version 1 would miss is still written as 1
MAX_NAME_BYTES = 200  # characters, of a group's name
LARGEST_SIZE = 4096  # of what the header's config counts


@dataclass(frozen=True)
class LoadedModel:
    """A model and what of its header evaluation needs, checked."""

    path: Path
    model: AdaAnchor4D
    frame: ModelFrame
    is_static: bool  # the coarse stage: the canonical anchors hold at every time
    background: tuple[float, float, float]
    training_seconds: float
    identity: Identity  # of what the file holds now
    capture_fingerprint: str | None  # of the capture, in files of older versions
    capture_folder: Path | None
    fps: float
    camera: PinholeCamera
    frames: tuple[Frame, ...]


def file_name_of(parameter: str) -> str:
    """The tensor's name in the file for a name in the module's state."""
    return parameter.replace("decoder.", "decoder_", 1).replace("aggregation.predictor.", "acfa.", 1)


def _is_plane(parameter: str) -> bool:
    return parameter.startswith("field.planes.")


def as_in_file(parameter: str, value: Tensor) -> Tensor:
    """A plane is [C, R2, R1] in the file, and every tensor is float32."""
    return (value.permute(2, 0, 1) if _is_plane(parameter) else value).float()


def _as_in_model(parameter: str, value: Tensor) -> Tensor:
    return value.permute(1, 2, 0) if _is_plane(parameter) and value.dim() == 3 else value


def save_model(
    path: Path,
    model: AdaAnchor4D,
    *,
    stage: str,
    capture: Capture,
    frame: ModelFrame,
    background: tuple[float, float, float],
    training: dict[str, Any],
    run: Identity | None = None,
) -> None:
    c = model.config
    groups = model.groups
    header = {
        "format": "aa4d-model",
        "version": 1 if groups is None else 2,
        "generator": f"aa4d {__version__}",
        "stage": stage,
        "config": {
            "offsets": c.offsets,
            "feature_dim": c.feature_dim,
            "embedding_dim": c.embedding_dim,
            "plane_dim": c.plane_dim,
            "levels": len(c.spatial_resolutions),
            "bins": c.bins,
            "aggregation": c.aggregation,
            "dlgd": c.dlgd,
            "dacw": c.dacw,
        },
        "model_to_world": frame.matrix().tolist(),
        "fps": capture.fps,
        "camera": capture.camera.as_json(),
        "frames": [f.as_json() for f in capture.frames],
        "capture": _relative(capture.folder, path.parent),
        "background": list(background),
        "training": training,
    }
    if groups is not None:
        header["groups"] = [{"name": name} for name in groups.names]
    tensors = {file_name_of(name): as_in_file(name, value).contiguous() for name, value in model.state_dict().items()}
    made_from = {"capture": capture.identity.digest()} | ({} if run is None else {"run": run.digest()})
    header["identity"] = Identity("model", content_of(header, tensors), made_from).as_json()
    _write(path, tensors, header)


def content_of(header: dict[str, Any], tensors: dict[str, Tensor]) -> str:
    """The digest of a model's content: everything but how, where and from what it was made."""
    held = {key: value for key, value in header.items() if key not in ("identity", "generator", "capture", "training")}
    return digest_of({"header": held, "tensors": {name: _digest_of_tensor(value) for name, value in tensors.items()}})


def _digest_of_tensor(value: Tensor) -> str:
    array = value.detach().cpu().contiguous().numpy()
    return hashlib.sha256(f"{array.dtype.str} {array.shape}".encode() + array.tobytes()).hexdigest()


def copy_model(source: Path, target: Path) -> None:
    """A copy at another place, its path to the capture mended."""
    loaded_header, tensors = read_tensors(source)
    capture = loaded_header.get("capture")
    if capture is not None:
        loaded_header["capture"] = _relative((source.parent / capture).resolve(), target.parent)
    _write(target, tensors, loaded_header)


def load_model(path: Path, device: torch.device | None = None) -> LoadedModel:
    """Raises InputError: absent, cut short, not safetensors, of a newer version, or not a whole model."""
    header, tensors = read_tensors(path)
    config = _config(header, tensors, path)
    n = len(_tensor(tensors, "anchors.position", path))
    model = blank_model(config, n, _groups(header, tensors, path))
    state = {name: _as_in_model(name, _tensor(tensors, file_name_of(name), path)) for name in model.state_dict()}
    for name, value in state.items():
        if not torch.isfinite(value).all():
            raise InputError(f"{path}: tensor {file_name_of(name)!r} holds NaN or infinity; train the model again")
    if model.groups is not None:
        state["anchors.group"] = _membership(state["anchors.group"], len(model.groups), path)
        _check_groups(state, path)
    try:
        model.load_state_dict(state)
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise InputError(f"{path}: the tensors do not fit the header's configuration ({reason})") from None
    if not config.dacw and not torch.equal(model.warp.boundaries, CoordinateWarp(config.bins).boundaries):
        raise InputError(f"{path}: the header says dacw false, but warp.boundaries are not uniform; train it again")
    try:
        return LoadedModel(
            path=path,
            model=model.to(device).eval(),
            frame=_frame(header["model_to_world"]),
            is_static={"coarse": True, "fine": False}[header["stage"]],
            background=_background(header["background"]),
            training_seconds=float(header["training"]["seconds"]),
            identity=_identity(header, tensors),
            capture_fingerprint=header["training"].get("capture_fingerprint"),
            capture_folder=None if header["capture"] is None else (path.parent / header["capture"]).resolve(),
            fps=number_of(header, "fps", path),
            camera=pinhole_camera(header, path),
            frames=_frames(header["frames"], path),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: the header is damaged ({error!r}); copy or train it again") from None


def _identity(header: dict[str, Any], tensors: dict[str, Tensor]) -> Identity:
    written = identity_of(header.get("identity"))
    return Identity("model", content_of(header, tensors), {} if written is None else written.made_from)


def read_tensors(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The checked `aa4d` header and all tensors of a model file."""
    try:
        with safe_open(str(path), framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118, not a dict
    except FileNotFoundError:
        if path.parent.is_file():
            raise InputError(f"{path.parent}: is a file; name the folder of the run that holds it") from None
        raise InputError(f"{path}: no such model file; make one with `aa4d train`") from None
    except (SafetensorError, OSError, ValueError, struct.error) as error:
        raise InputError(f"{path}: not a whole safetensors file ({error}); copy or train it again") from None
    try:
        header = json.loads(metadata["aa4d"])
        kind, version = header["format"], header["version"]
    except (KeyError, TypeError, json.JSONDecodeError):
        raise InputError(f"{path}: a safetensors file, but not an AdaAnchor4D model (no aa4d header)") from None
    if kind != "aa4d-model":
        raise InputError(f"{path}: the header says format {kind!r}, expected 'aa4d-model'")
    if not isinstance(version, int) or version < 1:
        raise InputError(f"{path}: model version {version!r} does not exist; copy or train it again")
    if version > MODEL_VERSION:
        raise InputError(f"{path}: model version {version} is newer than this aa4d reads ({MODEL_VERSION}); update")
    return header, tensors


def _config(header: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> ModelConfig:
    """Sizes that the header does not state stand in the tensors' shapes."""
    try:
        value = header["config"]
        if not isinstance(value, dict):
            raise TypeError("config is no object")
        for name in ("offsets", "feature_dim", "embedding_dim", "plane_dim", "levels", "bins"):
            if not 1 <= int(value[name]) <= LARGEST_SIZE:  # a damaged one must not fill the memory
                raise ValueError(f"{name} is {value[name]}")
        aggregation = value.get("aggregation", "acfa")
        if aggregation not in AGGREGATIONS:
            raise InputError(
                f"{path}: aggregation {aggregation!r} is unknown (known: {', '.join(AGGREGATIONS)}); update aa4d"
            )
        dlgd, dacw = _switch(value, "dlgd", path), _switch(value, "dacw", path)
        has_predictor = "acfa.hidden.bias" in tensors
        levels = range(int(value["levels"]))
        planes = [_tensor(tensors, f"field.planes.{level}.xt", path) for level in levels]
        return ModelConfig(
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
            geometry_hidden=len(_tensor(tensors, "dlgd_scale.hidden.bias", path))
            if dlgd
            else ModelConfig.geometry_hidden,
            encoder_width=len(_tensor(tensors, "encoder.bias", path)),
            decoder_hidden=len(_tensor(tensors, "decoder_opacity.hidden.bias", path)),
            aggregation=aggregation,
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None


def _groups(header: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Groups | None:
    """Blank ones of the file's shapes; None for a file without."""
    if header["version"] < 2:
        if "anchors.group" in tensors:
            raise InputError(f"{path}: version 1 knows no rigid groups, but the file holds some; train the model again")
        return None
    try:
        names = tuple(group["name"][:MAX_NAME_BYTES] for group in header["groups"])
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: the header's groups are damaged ({error!r}); train the model again") from None
    position = _tensor(tensors, "groups.position", path)
    if position.dim() != 3 or position.shape[0] != len(names) or position.shape[1] < FEWEST_CONTROLS:
        raise InputError(
            f"{path}: groups.position has shape {tuple(position.shape)}, expected [{len(names)}, C, 3] with C of at "
            f"least {FEWEST_CONTROLS}; train the model again"
        )
    return blank_groups(names, position.shape[1])


def _membership(value: Tensor, groups: int, path: Path) -> Tensor:
    """anchors.group as whole numbers."""
    if not ((value == value.round()) & (value >= -1) & (value < groups)).all():
        raise InputError(f"{path}: anchors.group names a group that is not there (has {groups}); train the model again")
    return value.long()


def _check_groups(state: dict[str, Tensor], path: Path) -> None:
    up, shown = state["groups.up"], state["groups.shown"]
    if abs(float(up.norm()) - 1) > 1e-3:
        raise InputError(f"{path}: groups.up is {up.tolist()}, expected a unit vector; train the model again")
    if shown.shape[-1] != 4 or (shown.diff(dim=-1) < 0).any():
        raise InputError(f"{path}: groups.shown holds times that go back; train the model again")


def _switch(config: dict[str, Any], name: str, path: Path) -> bool:
    """A part of the model that can be off; a file that does not say has it."""
    value = config.get(name, True)
    if not isinstance(value, bool):
        raise InputError(f"{path}: config.{name} is {value!r}, expected true or false; train the model again")
    return value


def _frame(value: Any) -> ModelFrame:
    """Raises ValueError for anything but a uniform scale and a translation."""
    frame = ModelFrame.from_matrix(np.array(value, np.float64).reshape(4, 4))
    if not (frame.unit_m > 0 and np.array_equal(frame.matrix(), value)):
        raise ValueError("model_to_world is not a uniform scale and a translation")
    return frame


def _frames(value: Any, path: Path) -> tuple[Frame, ...]:
    frames = tuple(frame_of_index(frame, number, path) for number, frame in enumerate(value))
    check_frames(frames, path)
    return frames


def _background(value: Any) -> tuple[float, float, float]:
    red, green, blue = (float(component) for component in value)
    if not np.isfinite([red, green, blue]).all():
        raise ValueError("background is not finite")
    return red, green, blue


def _tensor(tensors: dict[str, Tensor], name: str, path: Path) -> Tensor:
    if name not in tensors:
        raise InputError(f"{path}: tensor {name!r} is missing; train the model again")
    return tensors[name].float()


def _relative(target: Path, start: Path) -> str:
    return Path(os.path.relpath(target.resolve(), start.resolve())).as_posix()


def _write(path: Path, tensors: dict[str, Tensor], header: dict[str, Any]) -> None:
    with whole_file(path) as temporary:
        save_file(tensors, str(temporary), metadata={"aa4d": json.dumps(header, allow_nan=False)})

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
from aa4d.capture.frame import LARGEST_UNIT_M, SMALLEST_UNIT_M, ModelFrame
from aa4d.capture.reader import Capture
from aa4d.capture.schema import (
    FARTHEST_M,
    Frame,
    PinholeCamera,
    check_frames,
    frame_of_index,
    frame_rate,
    number_of,
    pinhole_camera,
)
from aa4d.errors import InputError
from aa4d.files import whole_file
from aa4d.identity import Identity, digest_of, identity_of
from aa4d.methods import DEFAULT, METHODS, method_of
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.contract import Method
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.tensors import tensor_of
from aa4d.motion.groups import Groups, blank_groups
from aa4d.motion.spline import FEWEST_CONTROLS

MODEL_VERSION = 3  # the newest that is read; a file has the lowest version whose readers understand it whole
# docs/formats.md, "What readers refuse": the limits that the extension holds as well.
METHODS_VERSION = 3  # the first of other methods than the default one
LONGEST_NAME = 200  # characters, of a group's name
FARTHEST_MODEL_M = 2 * FARTHEST_M  # learning moves anchors on from points that a capture holds within `FARTHEST_M`


@dataclass(frozen=True)
class LoadedModel:
    """A model and what of its header evaluation needs, checked."""

    path: Path
    method: str  # a name in `aa4d.methods.METHODS`
    model: SceneModel
    frame: ModelFrame
    is_static: bool  # of a canonical stage: the same at every time
    background: tuple[float, float, float]
    training_seconds: float
    training_processor_seconds: float | None  # None in files of older versions
    identity: Identity  # of what the file holds now
    capture_fingerprint: str | None  # of the capture, in files of older versions
    capture_folder: Path | None
    fps: float
    camera: PinholeCamera
    frames: tuple[Frame, ...]

    def seconds_at(self, t: float) -> float:
        """Seconds of the clip at t in [0, 1]: linear between frames, whose seconds need not be even."""
        return float(np.interp(t, [f.t for f in self.frames], [f.time_s for f in self.frames]))


def save_model(
    path: Path,
    method: str,
    model: SceneModel,
    *,
    is_static: bool,
    capture: Capture,
    frame: ModelFrame,
    background: tuple[float, float, float],
    training: dict[str, Any],
    run: Identity | None = None,
) -> None:
    groups, its = model.groups, method_of(method)
    header = {
        "format": "aa4d-model",
        "version": 3 if method != DEFAULT else 1 if groups is None else 2,
        "generator": f"aa4d {__version__}",
        "method": method,
        "stage": "coarse" if is_static else "fine",
        "config": its.header(model),
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
    tensors = {its.file_name(name): its.to_file(name, v).contiguous() for name, v in model.state_dict().items()}
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
    method = _method(header, path)
    if not isinstance(header.get("config"), dict):
        raise InputError(f"{path}: the header's config is wrong (no object); train the model again")
    model = method.blank_of_file(header["config"], tensors, path)
    if not len(model):
        raise InputError(f"{path}: holds nothing to draw; train the model again")
    if (groups := _groups(header, tensors, path)) is not None:
        if not isinstance(model, AnchorModel):
            raise InputError(f"{path}: holds rigid groups, on which nothing of method {method.name!r} rides")
        model.ride(groups, torch.zeros(len(model), dtype=torch.long))
    _load_state(model, method, tensors, path)
    method.check(model, path)
    try:
        _check_places(model, _frame(header["model_to_world"]), path)
        return LoadedModel(
            path=path,
            method=method.name,
            model=model.to(device).eval().requires_grad_(False),  # it is drawn, not trained
            frame=_frame(header["model_to_world"]),
            is_static={"coarse": True, "fine": False}[header["stage"]],
            background=_background(header["background"]),
            training_seconds=_seconds(header["training"], "seconds", path),
            training_processor_seconds=_processor_seconds(header["training"], path),
            identity=_identity(header, tensors),
            capture_fingerprint=header["training"].get("capture_fingerprint"),
            capture_folder=None if header["capture"] is None else (path.parent / header["capture"]).resolve(),
            fps=frame_rate(header, path),
            camera=pinhole_camera(header, path),
            frames=_frames(header["frames"], path),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
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
    except (KeyError, TypeError, ValueError, RecursionError):
        raise InputError(f"{path}: a safetensors file, but not an AdaAnchor4D model (no aa4d header)") from None
    if kind != "aa4d-model":
        raise InputError(f"{path}: the header says format {kind!r}, expected 'aa4d-model'")
    if type(version) is not int or version < 1:
        raise InputError(f"{path}: model version {version!r} does not exist; copy or train it again")
    if version > MODEL_VERSION:
        raise InputError(f"{path}: model version {version} is newer than this aa4d reads ({MODEL_VERSION}); update")
    for name, value in tensors.items():
        if value.dtype != torch.float32:
            raise InputError(f"{path}: tensor {name!r} is {value.dtype}, expected float32; train the model again")
    return header, tensors


def _method(header: dict[str, Any], path: Path) -> Method[Any]:
    """The default one for a file of before there were several."""
    name = header.get("method", DEFAULT)
    if not isinstance(name, str) or name not in METHODS:
        raise InputError(f"{path}: method {name!r} is unknown (known: {', '.join(METHODS)}); update aa4d")
    if name != DEFAULT and header["version"] < METHODS_VERSION:
        raise InputError(f"{path}: version {header['version']} knows no method {name!r}; train the model again")
    return method_of(name)


def _load_state(model: SceneModel, method: Method[Any], tensors: dict[str, Tensor], path: Path) -> None:
    state = {}
    for name in model.state_dict():
        value = method.from_file(name, tensor_of(tensors, method.file_name(name), path))
        if not torch.isfinite(value).all():
            raise InputError(f"{path}: tensor {method.file_name(name)!r} holds NaN or infinity; train the model again")
        state[name] = value
    if model.groups is not None:
        state["anchors.group"] = _membership(state["anchors.group"], len(model.groups), path)
        _check_groups(state, path)
    try:
        model.load_state_dict(state)
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise InputError(f"{path}: the tensors do not fit the header's configuration ({reason})") from None


def _groups(header: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Groups | None:
    """Blank ones of the file's shapes; None for a file without."""
    if header["version"] < 2 and "anchors.group" in tensors:
        raise InputError(f"{path}: version 1 knows no rigid groups, but the file holds some; train the model again")
    if header["version"] < 2 or (header["version"] > 2 and "groups" not in header):
        return None
    try:
        names = tuple(group["name"] for group in header["groups"])
        if not all(isinstance(name, str) and len(name) <= LONGEST_NAME for name in names):
            raise TypeError(f"a name is not a text of at most {LONGEST_NAME} characters")
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: the header's groups are damaged ({error!r}); train the model again") from None
    position = tensor_of(tensors, "groups.position", path)
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


def _frame(value: Any) -> ModelFrame:
    """Raises ValueError for anything but a uniform scale and a translation."""
    frame = ModelFrame.from_matrix(np.array(value, np.float64).reshape(4, 4))
    is_sane = SMALLEST_UNIT_M <= frame.unit_m <= LARGEST_UNIT_M and np.isfinite(frame.matrix()).all()
    if not (is_sane and np.array_equal(frame.matrix(), value)):
        raise ValueError(
            f"model_to_world is not a uniform scale of {SMALLEST_UNIT_M:g} to {LARGEST_UNIT_M:g} and a translation"
        )
    return frame


def _frames(value: Any, path: Path) -> tuple[Frame, ...]:
    frames = tuple(frame_of_index(frame, number, path) for number, frame in enumerate(value))
    check_frames(frames, path)
    return frames


def _background(value: Any) -> tuple[float, float, float]:
    red, green, blue = (float(component) for component in value)
    if not all(0 <= component <= 1 for component in (red, green, blue)):
        raise ValueError("background is outside [0, 1]")
    return red, green, blue


def _seconds(training: dict[str, Any], key: str, path: Path) -> float:
    seconds = number_of(training, key, path, "training")
    if seconds < 0:
        raise ValueError(f"training.{key} is negative")
    return seconds


def _processor_seconds(training: dict[str, Any], path: Path) -> float | None:
    key = "processor_seconds"
    return _seconds(training, key, path) if key in training else None


def _check_places(model: SceneModel, frame: ModelFrame, path: Path) -> None:
    """Raises InputError where something stands outside of a local world."""
    places = [model.resting(None)]
    if model.groups is not None:
        places += [model.groups.position.reshape(-1, 3), model.groups.reference[:, :3]]
    reach = np.abs(torch.cat(places).detach().double().numpy() * frame.unit_m + frame.origin_m).max()
    if not reach <= FARTHEST_MODEL_M:
        raise InputError(f"{path}: places something {reach:.3g} m from the origin, over {FARTHEST_MODEL_M:g} m")


def _relative(target: Path, start: Path) -> str:
    return Path(os.path.relpath(target.resolve(), start.resolve())).as_posix()


def _write(path: Path, tensors: dict[str, Tensor], header: dict[str, Any]) -> None:
    with whole_file(path) as temporary:
        save_file(tensors, str(temporary), metadata={"aa4d": json.dumps(header, allow_nan=False)})

"""Unusable model files, each with words that its one-sentence refusal must hold."""

import copy
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from model_files import header_and_data, make_model, write_file, write_model


class Exploit:
    """Unpickling this would leave a trace."""

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, ("import builtins; builtins.aa4d_exploited = True",)


def with_tensor(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], object]:
    """A file with one tensor changed."""

    def write(path: Path) -> object:
        tensors, information = make_model(20)
        tensors[name] = change(tensors[name])
        return write_model(path, tensors, information)

    return write


def with_information(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
    """A file with changed metadata."""

    def write(path: Path) -> object:
        tensors, information = make_model(20)
        change(information)
        return write_model(path, tensors, information)

    return write


def with_header(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
    """A file whose container lies."""

    def write(path: Path) -> object:
        header, data = header_and_data(*make_model(20))
        changed = copy.deepcopy(header)
        change(changed)
        return write_file(path, changed, data)

    return write


def grouped(
    tensor: str | None = None,
    change: Callable[[np.ndarray], np.ndarray | None] = np.copy,
    information: Callable[[dict[str, Any]], object] = lambda _: None,
) -> Callable[[Path], object]:
    """A file of version 2 with one tensor changed (left out where it becomes None), or changed metadata."""

    def write(path: Path) -> object:
        tensors, metadata = make_model(20, groups=3)
        information(metadata)
        if tensor is not None:
            changed = change(tensors.pop(tensor))
            if changed is not None:
                tensors[tensor] = changed
        return write_model(path, tensors, metadata)

    return write


def cut(keep: Callable[[bytes], int]) -> Callable[[Path], object]:
    """The beginning of a good file."""

    def write(path: Path) -> object:
        write_model(path, *make_model(20))
        content = path.read_bytes()
        return path.write_bytes(content[: keep(content)])

    return write


def not_a_number(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flat[3] = np.nan
    return array


def _overlap(header: dict[str, Any]) -> None:
    header["anchors.feature"]["data_offsets"] = [offset - 4 for offset in header["anchors.feature"]["data_offsets"]]


def _shear(information: dict[str, Any]) -> None:
    information["model_to_world"][0][1] = 3.0


def swollen(path: Path) -> object:
    """Many bare anchors and wide planes of one texel: a small file that asks for gigabytes."""
    tensors, information = make_model(20)
    C = 4096
    anchors = 40_000
    information["config"].update(plane_dim=C, offsets=1, feature_dim=1, embedding_dim=1, dlgd=False)
    shapes = {"anchors.position": (3,), "anchors.feature": (1,), "anchors.offset": (1, 3), "anchors.log_scale": (6,)}
    shapes["anchors.embedding_acfa"] = (1,)
    small: dict[str, np.ndarray] = {name: np.zeros((anchors, *shape), np.float32) for name, shape in shapes.items()}

    def network(name: str, outputs: int, inputs: int) -> None:
        small[f"{name}.hidden.weight"], small[f"{name}.hidden.bias"] = np.zeros((1, inputs)), np.zeros(1)
        small[f"{name}.output.weight"], small[f"{name}.output.bias"] = np.zeros((outputs, 1)), np.zeros(outputs)

    for name, outputs, inputs in (
        ("decoder_opacity", 1, 4),
        ("decoder_color", 3, 4),
        ("decoder_covariance", 7, 4),
        ("acfa", 6 * C, 2),
        ("head_position", 3, 1),
        ("head_feature", 1, 1),
    ):
        network(name, outputs, inputs)
    small["encoder.weight"], small["encoder.bias"] = np.zeros((1, 2 * C)), np.zeros(1)
    small.update({name: np.zeros((C, 1, 1)) for name in tensors if name.startswith("field.planes")})
    small.update({name: tensors[name] for name in ("field.box", "warp.boundaries")})
    return write_model(path, small, information)


def overflowing(array: np.ndarray) -> np.ndarray:
    return np.full_like(array, 1e38)


# Files that can be read, but not evaluated.
OVERFLOWING: dict[str, Callable[[Path], object]] = {
    "weights": with_tensor("head_position.output.weight", overflowing),
    "scales": with_tensor("anchors.log_scale", overflowing),
}

BAD_FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(missing_ok=True), "cannot be read"),
    "a folder": (lambda path: path.mkdir(), "cannot be read"),
    "empty": (lambda path: path.write_bytes(b""), "not a safetensors file"),
    "a text": (lambda path: path.write_text("not a model " * 100), "not a safetensors file"),
    "a pickle": (lambda path: path.write_bytes(pickle.dumps(Exploit())), "not a safetensors file"),
    "cut in the header": (cut(lambda content: len(content) // 100), "cut short"),
    "cut in the tensors": (cut(lambda content: len(content) - 1000), "cut short"),
    "a header of two gigabytes": (
        lambda path: path.write_bytes(struct.pack("<Q", 2**31) + b"{" + b" " * 64),
        "header of 2147483648 bytes",
    ),
    "a header of 2^63 bytes": (lambda path: path.write_bytes(struct.pack("<Q", 2**63) + b"{}"), "bytes"),
    "a header that is not JSON": (lambda path: path.write_bytes(struct.pack("<Q", 4) + b"{abc"), "not JSON"),
    "a header nested too deep": (
        lambda path: path.write_bytes(struct.pack("<Q", 200005) + b'{"a":' + b"[" * 200000),
        "not JSON",
    ),
    "a header that is text": (lambda path: path.write_bytes(struct.pack("<Q", 4) + b"\xff\xfe{}"), "not a safetensors"),
    "a tensor outside the file": (
        with_header(lambda header: header["anchors.position"].update(data_offsets=[10**12, 10**12 + 240])),
        "cut short",
    ),
    "negative offsets": (
        with_header(lambda header: header["anchors.position"].update(data_offsets=[-240, 0])),
        "impossible",
    ),
    "overlapping tensors": (with_header(_overlap), "overlaps"),
    "bytes that no tensor names": (with_header(lambda header: header.pop("anchors.feature")), "unnamed bytes"),
    "a shape that does not fit": (
        with_header(lambda header: header["anchors.position"].update(shape=[2**40, 3])),
        "do not fit its shape",
    ),
    "a shape of booleans": (
        with_header(lambda header: header["anchors.position"].update(shape=[True, 3])),
        "impossible",
    ),
    "a tensor without offsets": (with_header(lambda header: header["anchors.position"].pop("data_offsets")), "lacks"),
    "a tensor that is a number": (with_header(lambda header: header.update({"anchors.position": 3})), "lacks"),
    "half precision": (with_header(lambda header: header["anchors.position"].update(dtype="F16")), "F16"),
    "no metadata": (with_header(lambda header: header.pop("__metadata__")), "not an AdaAnchor4D model"),
    "metadata that is a list": (with_header(lambda header: header.update(__metadata__=[])), "__metadata__"),
    "metadata that is not JSON": (
        with_header(lambda header: header.update(__metadata__={"aa4d": "{"})),
        "not an AdaAnchor4D model",
    ),
    "metadata of another kind": (with_header(lambda header: header.update(__metadata__={"aa4d": "3"})), "not an Ada"),
    "another format": (with_information(lambda info: info.update(format="aa4d-capture")), "not an AdaAnchor4D model"),
    "a newer version": (with_information(lambda info: info.update(version=3)), "newer"),
    "no version": (with_information(lambda info: info.pop("version")), "version"),
    "an unknown stage": (with_information(lambda info: info.update(stage="medium")), "medium"),
    "no configuration": (with_information(lambda info: info.pop("config")), "config"),
    "a negative size": (with_information(lambda info: info["config"].update(offsets=-1)), "config.offsets"),
    "an immense size": (with_information(lambda info: info["config"].update(levels=10**9)), "config.levels"),
    "an unknown aggregation": (with_information(lambda info: info["config"].update(aggregation="sum")), "'sum'"),
    "a sheared frame": (with_information(_shear), "model_to_world"),
    "no frames": (with_information(lambda info: info.update(frames=[])), "at least one frame"),
    "a frame without a pose": (with_information(lambda info: info["frames"][2].pop("viewmat")), "viewmat"),
    "a pose that is not a number": (
        with_information(lambda info: info["frames"][2]["viewmat"][0].__setitem__(0, float("nan"))),
        "viewmat of frame 2",
    ),
    "a pose that is not rigid": (
        with_information(lambda info: info["frames"][2]["viewmat"][0].__setitem__(0, 7.0)),
        "viewmat of frame 2",
    ),
    "no frame rate": (with_information(lambda info: info.update(fps=0)), "fps"),
    "an immense frame rate": (with_information(lambda info: info.update(fps=10**400)), "not usable"),
    "frames that are numbers": (with_information(lambda info: info.update(frames=[3])), "not laid out"),
    "a background beyond white": (with_information(lambda info: info.update(background=[1e40, 0, 0])), "[0, 1]"),
    "another camera": (with_information(lambda info: info["camera"].update(model="FISHEYE")), "PINHOLE"),
    "a camera without K": (with_information(lambda info: info["camera"].pop("K")), "K"),
    "positions that are not numbers": (with_tensor("anchors.position", not_a_number), "not finite"),
    "weights that are not numbers": (with_tensor("encoder.weight", not_a_number), "not finite"),
    "a position beyond the world": (with_tensor("anchors.position", lambda array: array * 1e6), "from the origin"),
    "no anchors": (with_tensor("anchors.position", lambda array: array[:0]), "no anchors"),
    "too few features": (with_tensor("anchors.feature", lambda array: array[:-1]), "anchors.feature has shape"),
    "a flat plane": (with_tensor("field.planes.1.xt", lambda array: array[0]), "field.planes.1.xt has shape"),
    "layers that do not fit": (with_tensor("acfa.hidden.bias", lambda array: array[:-1]), "acfa.hidden.bias has shape"),
    "a scalar weight": (with_tensor("encoder.weight", lambda array: array[0, 0]), "encoder.weight has shape"),
    "an immense layer": (
        with_tensor("acfa.hidden.weight", lambda array: np.zeros((5000, array.shape[1]), np.float32)),
        "5000 wide",
    ),
    "more memory than it justifies": (swollen, "out of proportion"),
    "boundaries that go back": (with_tensor("warp.boundaries", lambda array: -array), "must not decrease"),
    "a box turned over": (with_tensor("field.box", lambda array: array[::-1]), "field.box"),
    "version 2 without groups": (with_information(lambda info: info.update(version=2)), "'groups'"),
    "groups that are no list": (grouped(information=lambda info: info.update(groups={"name": "a"})), "must be a list"),
    "a group that is a text": (grouped(information=lambda info: info.update(groups=["a", "b", "c"])), "not laid out"),
    "a group without a name": (grouped(information=lambda info: info["groups"][1].clear()), "'name'"),
    "a name that is a number": (grouped(information=lambda info: info["groups"][1].update(name=7)), "name of group 1"),
    "an endless name": (
        grouped(information=lambda info: info["groups"][1].update(name="x" * 10**6)),
        "name of group 1",
    ),
    "more names than groups": (
        grouped(information=lambda info: info["groups"].append({"name": "d"})),
        "groups.position has shape",
    ),
    "no membership": (grouped("anchors.group", lambda _: None), "lacks the tensor anchors.group"),
    "membership of too few": (grouped("anchors.group", lambda a: a[1:]), "anchors.group has shape"),
    "a group that is not there": (grouped("anchors.group", lambda a: np.where(a == 2, 3, a)), "not there"),
    "half a group": (grouped("anchors.group", lambda a: a + 0.5), "not there"),
    "a group below the world": (grouped("anchors.group", lambda a: a - 1), "not there"),
    "a group that is not a number": (grouped("anchors.group", not_a_number), "not finite"),
    "three control points": (grouped("groups.position", lambda a: a[:, :3]), "C of at least 4"),
    "flat trajectories": (grouped("groups.position", lambda a: a[..., 0]), "groups.position has shape"),
    "control points in a plane": (grouped("groups.position", lambda a: a[..., :2]), "groups.position has shape"),
    "fewer headings than positions": (grouped("groups.heading", lambda a: a[:, 1:]), "groups.heading has shape"),
    "a heading that is not a number": (grouped("groups.heading", not_a_number), "not finite"),
    "a trajectory out of the world": (grouped("groups.position", lambda a: a * 1e6), "places a group"),
    "a reference out of the world": (grouped("groups.reference", lambda a: a + 1e9), "places a group"),
    "a reference without heading": (grouped("groups.reference", lambda a: a[:, :3]), "groups.reference has shape"),
    "three times": (grouped("groups.shown", lambda a: a[:, :3]), "groups.shown has shape"),
    "times that go back": (grouped("groups.shown", lambda a: a[:, ::-1]), "do not decrease"),
    "an axis too long": (grouped("groups.up", lambda a: 2 * a), "length 1, not 2"),
    "no axis": (grouped("groups.up", lambda a: 0 * a), "length 1, not 0"),
    "no up": (grouped("groups.up", lambda _: None), "lacks the tensor groups.up"),
    "a tensor too few": (
        lambda path: write_model(
            path, {k: v for k, v in make_model(20)[0].items() if k != "encoder.bias"}, make_model(20)[1]
        ),
        "lacks the tensor encoder.bias",
    ),
}

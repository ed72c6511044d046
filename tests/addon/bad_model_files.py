"""Model files for both readers, the extension's and aa4d's (docs/formats.md, "What readers refuse").

BAD_FILES: what both refuse, with words that the extension's one sentence must hold. GOOD_FILES: what both accept,
limits included. OVERFLOWING and OVERSIZED are whole files too, but of models that cannot be evaluated.
"""

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


def turn_on_edge(information: dict[str, Any]) -> None:
    """A clip of one frame, at the limits of what its camera, pace and names may be."""
    del information["frames"][1:]
    information["frames"][0].update(name="x" * 200, split="train", t=1, time_s=-3)
    information["camera"].update(width=16_384, height=1, K=[[1e6, 0, -1e6], [0, 1e-6, 0], [0, 0, 1]])
    information.update(fps=1000, background=[0, 1, 0.5], capture="../captures/elsewhere", training={"seconds": 0})


def good(
    change: Callable[[dict[str, np.ndarray], dict[str, Any]], object] = lambda _tensors, _information: None,
    **options: Any,
) -> Callable[[Path], object]:
    """A file of `make_model`, changed."""

    def write(path: Path) -> object:
        tensors, information = make_model(20, **options)
        change(tensors, information)
        return write_model(path, tensors, information)

    return write


def flatten(*axes: int) -> Callable[[dict[str, np.ndarray], dict[str, Any]], object]:
    """Anchors on one plane, or on one line, and the box that training then gives to the field."""

    def change(tensors: dict[str, np.ndarray], _: dict[str, Any]) -> None:
        position = tensors["anchors.position"]
        position[:, list(axes)] = [0.25, -0.5, 0.125][: len(axes)]
        tensors["field.box"] = np.stack([position.min(axis=0), position.max(axis=0)])

    return change


def without_warp(tensors: dict[str, np.ndarray], information: dict[str, Any]) -> None:
    information["config"]["dacw"] = False
    tensors["warp.boundaries"] = np.tile(np.linspace(-1, 1, 6, dtype=np.float32), (3, 1))


def nobody_rides(tensors: dict[str, np.ndarray], information: dict[str, Any]) -> None:
    tensors["anchors.group"][:] = -1
    for name in [name for name in tensors if name.startswith("groups.") and name != "groups.up"]:
        tensors[name] = tensors[name][:0]
    information["groups"] = []


GOOD_FILES: dict[str, Callable[[Path], object]] = {
    "of one stage": good(stage="coarse"),
    "of one anchor": good(lambda tensors, _: tensors.update({k: v[:1] for k, v in tensors.items() if k[:3] == "anc"})),
    **{f"with {name}": good(aggregation=name) for name in ("acfa", "anchor_only", "time_only", "mean", "product")},
    "without DLGD": good(dlgd=False),
    "without DACW": good(without_warp),
    "that says neither": good(
        lambda _, info: [info["config"].pop(name) for name in ("aggregation", "dlgd", "dacw")],
    ),
    "with groups": good(groups=3, up=(0.3, -0.5, 0.7)),
    "with groups that nobody rides": good(nobody_rides, groups=3),
    "with long names": good(lambda _, info: info["groups"][1].update(name="é" * 200), groups=3),
    "on one plane": good(flatten(2)),
    "on one line": good(flatten(0, 2)),
    "in one place": good(flatten(0, 1, 2)),
    "with bins that take no room": good(
        lambda tensors, _: tensors["warp.boundaries"].__setitem__((0, slice(1, 3)), -1.0),
    ),
    "that says its method": good(lambda _, info: info.update(method="adaanchor4d")),
    "at its limits": good(lambda _, info: turn_on_edge(info)),
    "far out": good(lambda tensors, _: tensors["anchors.position"].__setitem__(0, [1660, -1660, 0])),
    "with notes of another program": good(
        lambda tensors, info: (tensors.update(notes=np.full(5, np.nan, np.float32)), info.update(notes=[1])),
    ),
}

# Files that can be read, but not evaluated.
OVERFLOWING: dict[str, Callable[[Path], object]] = {
    "weights": with_tensor("head_position.output.weight", overflowing),
    "scales": with_tensor("anchors.log_scale", overflowing),
}

OVERSIZED = swollen  # read too, but refused when it is made ready for evaluation


def first_frame(**values: Any) -> Callable[[Path], object]:
    """A file whose first frame says this."""
    return with_information(lambda info: info["frames"][0].update(values))


def metadata(text: str) -> Callable[[Path], object]:
    """A file whose metadata is this text."""
    return with_header(lambda header: header.update(__metadata__={"aa4d": text}))


def halved(path: Path) -> object:
    """A file with one tensor of half precision, whole otherwise."""
    tensors, information = make_model(20)
    header, data = header_and_data(tensors, information)
    last = list(tensors)[-1]
    start, end = header[last]["data_offsets"]
    header[last].update(dtype="F16", data_offsets=[start, start + (end - start) // 2])
    return write_file(path, header, data[:start] + tensors[last].astype("<f2").tobytes())


def narrow(tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Phi_x one unit narrower than the encoder."""
    for name, part in (("hidden.weight", np.s_[1:]), ("hidden.bias", np.s_[1:]), ("output.weight", np.s_[:, 1:])):
        tensors[f"head_position.{name}"] = tensors[f"head_position.{name}"][part]
    return tensors


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
    "half precision in a whole file": (halved, "F16"),
    "metadata nested too deep": (metadata("[" * 100_000), "not an Ada"),
    "metadata with a number without end": (
        metadata('{"format": "aa4d-model", "version": ' + "9" * 5000 + "}"),
        "not an",
    ),
    "no metadata": (with_header(lambda header: header.pop("__metadata__")), "not an AdaAnchor4D model"),
    "metadata that is a list": (with_header(lambda header: header.update(__metadata__=[])), "__metadata__"),
    "metadata that is not JSON": (
        with_header(lambda header: header.update(__metadata__={"aa4d": "{"})),
        "not an AdaAnchor4D model",
    ),
    "metadata of another kind": (with_header(lambda header: header.update(__metadata__={"aa4d": "3"})), "not an Ada"),
    "another format": (with_information(lambda info: info.update(format="aa4d-capture")), "not an AdaAnchor4D model"),
    "a newer version": (with_information(lambda info: info.update(version=4)), "newer"),
    "another method": (with_information(lambda info: info.update(version=3, method="nerf")), "track file"),
    "another method before there were any": (with_information(lambda info: info.update(method="fourdgs")), "method"),
    "a method that is a number": (with_information(lambda info: info.update(method=4)), "method"),
    "a version that is true": (with_information(lambda info: info.update(version=True)), "version"),
    "no version": (with_information(lambda info: info.pop("version")), "version"),
    "an unknown stage": (with_information(lambda info: info.update(stage="medium")), "medium"),
    "no configuration": (with_information(lambda info: info.pop("config")), "config"),
    "a negative size": (with_information(lambda info: info["config"].update(offsets=-1)), "config.offsets"),
    "a size that is a fraction": (with_information(lambda info: info["config"].update(levels=2.5)), "config.levels"),
    "a size that is a text": (with_information(lambda info: info["config"].update(levels="2")), "config.levels"),
    "a switch that is a number": (with_information(lambda info: info["config"].update(dacw=1)), "config.dacw"),
    "a bent warp that says it is none": (
        with_information(lambda info: info["config"].update(dacw=False)),
        "not uniform",
    ),
    "an immense size": (with_information(lambda info: info["config"].update(levels=10**9)), "config.levels"),
    "an unknown aggregation": (with_information(lambda info: info["config"].update(aggregation="sum")), "'sum'"),
    "a sheared frame": (with_information(_shear), "model_to_world"),
    "a frame that is nearly uniform": (
        with_information(lambda info: info["model_to_world"][1].__setitem__(1, 12.000001)),
        "model_to_world",
    ),
    "a frame that turns a little": (
        with_information(lambda info: info["model_to_world"][1].__setitem__(0, 1e-9)),
        "model_to_world",
    ),
    "a frame that is nowhere": (
        with_information(lambda info: info["model_to_world"][0].__setitem__(3, float("inf"))),
        "model_to_world",
    ),
    "a frame of numbers in a row": (
        with_information(lambda info: info.update(model_to_world=np.ravel(info["model_to_world"]).tolist())),
        "model_to_world",
    ),
    "a frame's name twice": (
        with_information(lambda info: info["frames"][1].update(name="000000")),
        "the name of frame 1",
    ),
    "a frame's name that leads elsewhere": (first_frame(name="../000000"), "the name of frame 0"),
    "a frame's name that is hidden": (first_frame(name=".000000"), "the name of frame 0"),
    "a frame's name of no length": (first_frame(name=""), "the name of frame 0"),
    "a frame's name without end": (first_frame(name="é" * 101), "the name of frame 0"),
    "a frame's name that is no text": (first_frame(name="\ud800"), "not usable"),
    "an image outside of the capture": (first_frame(image="frames/../../secret.png"), "image of frame 0"),
    "an image anywhere": (first_frame(image="/etc/secret.png"), "image of frame 0"),
    "an image that is a number": (first_frame(image=3), "image of frame 0"),
    "a frame without an image": (with_information(lambda info: info["frames"][0].pop("image")), "'image'"),
    "a frame without seconds": (with_information(lambda info: info["frames"][0].pop("time_s")), "'time_s'"),
    "a frame that is a text of seconds": (first_frame(time_s="0"), "time_s of frame 0"),
    "times that stand still": (with_information(lambda info: info["frames"][2].update(t=0.25)), "t of frame 2"),
    "a time before the clip": (first_frame(t=-0.1), "t of frame 0"),
    "a time after the clip": (with_information(lambda info: info["frames"][-1].update(t=1.001)), "t of frame 4"),
    "a split of another kind": (first_frame(split="validation"), "split of frame 0"),
    "nothing to train on": (
        with_information(lambda info: [frame.update(split="test") for frame in info["frames"]]),
        "trained on",
    ),
    "a camera beyond the world": (
        with_information(lambda info: info["frames"][2]["viewmat"][1].__setitem__(3, 12_000.0)),
        "camera of frame 2",
    ),
    "a pose with another last row": (
        with_information(lambda info: info["frames"][2]["viewmat"][3].__setitem__(3, 1.001)),
        "viewmat of frame 2",
    ),
    "a pose of immense numbers": (
        with_information(lambda info: info["frames"][2]["viewmat"][0].__setitem__(3, 10**400)),
        "viewmat of frame 2",
    ),
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
    "a frame rate beyond a thousand": (with_information(lambda info: info.update(fps=1001)), "fps"),
    "a frame rate that is a text": (with_information(lambda info: info.update(fps="25")), "fps"),
    "an immense frame rate": (with_information(lambda info: info.update(fps=10**400)), "not usable"),
    "frames that are numbers": (with_information(lambda info: info.update(frames=[3])), "not laid out"),
    "a background beyond white": (with_information(lambda info: info.update(background=[1e40, 0, 0])), "[0, 1]"),
    "a background blacker than black": (with_information(lambda info: info.update(background=[0, -0.01, 0])), "[0, 1]"),
    "a background of two": (with_information(lambda info: info.update(background=[0, 1])), "background"),
    "training of less than no time": (
        with_information(lambda info: info["training"].update(seconds=-1)),
        "training.seconds",
    ),
    "training without a clock": (with_information(lambda info: info["training"].clear()), "'seconds'"),
    "no capture": (with_information(lambda info: info.pop("capture")), "'capture'"),
    "a capture that is a number": (with_information(lambda info: info.update(capture=7)), "capture"),
    "a picture too wide": (with_information(lambda info: info["camera"].update(width=16_385)), "camera.width"),
    "a picture that is true": (with_information(lambda info: info["camera"].update(height=True)), "camera.height"),
    "a picture of half a pixel": (with_information(lambda info: info["camera"].update(height=180.5)), "camera.height"),
    "an immense focal length": (
        with_information(lambda info: info["camera"]["K"][0].__setitem__(0, 1.1e6)),
        "camera.K",
    ),
    "a skewed camera": (with_information(lambda info: info["camera"]["K"][0].__setitem__(1, 0.1)), "camera.K"),
    "a camera without focus": (with_information(lambda info: info["camera"]["K"][1].__setitem__(1, 0)), "camera.K"),
    "a camera with distortion": (
        with_information(lambda info: info["camera"].update(distortion={"k1": 0.1})),
        "camera",
    ),
    "seconds of no clip": (with_information(lambda info: info["frames"][-1].update(time_s=1e300)), "time_s of frame"),
    "seconds that go back": (with_information(lambda info: info["frames"][2].update(time_s=0.0)), "time_s of frame 2"),
    "another camera": (with_information(lambda info: info["camera"].update(model="FISHEYE")), "PINHOLE"),
    "a camera without K": (with_information(lambda info: info["camera"].pop("K")), "K"),
    "positions that are not numbers": (with_tensor("anchors.position", not_a_number), "not finite"),
    "weights that are not numbers": (with_tensor("encoder.weight", not_a_number), "not finite"),
    "a position beyond the world": (with_tensor("anchors.position", lambda array: array * 1e6), "from the origin"),
    "no anchors": (with_tensor("anchors.position", lambda array: array[:0]), "no anchors"),
    "too few features": (with_tensor("anchors.feature", lambda array: array[:-1]), "anchors.feature has shape"),
    "a flat plane": (with_tensor("field.planes.1.xt", lambda array: array[0]), "field.planes.1.xt has shape"),
    "layers that do not fit": (with_tensor("acfa.hidden.bias", lambda array: array[:-1]), "acfa.hidden.bias has shape"),
    "planes of two sizes": (
        with_tensor("field.planes.1.yz", lambda array: array[:, 1:]),
        "field.planes.1.yz has shape",
    ),
    "planes of two lengths": (with_tensor("field.planes.1.zt", lambda array: array[:, 1:]), "field.planes.1.zt has"),
    "heads narrower than the encoder": (
        lambda path: write_model(path, narrow(make_model(20)[0]), make_model(20)[1]),
        "head_position.hidden.weight has shape",
    ),
    "a scalar weight": (with_tensor("encoder.weight", lambda array: array[0, 0]), "encoder.weight has shape"),
    "an immense layer": (
        with_tensor("acfa.hidden.weight", lambda array: np.zeros((5000, array.shape[1]), np.float32)),
        "5000 wide",
    ),
    "boundaries that go back": (with_tensor("warp.boundaries", lambda array: -array), "must not decrease"),
    "a box turned over": (with_tensor("field.box", lambda array: array[::-1]), "field.box"),
    "a box turned over along one axis": (
        with_tensor("field.box", lambda array: np.where([False, False, True], array[::-1], array)),
        "field.box",
    ),
    "groups in a file of version 1": (grouped(information=lambda info: info.update(version=1)), "version 1"),
    "no start": (grouped("groups.start", lambda _: None), "lacks the tensor groups.start"),
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
    "a reference out of the world": (grouped("groups.reference", lambda a: a + 1e9), "from the origin"),
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

"""The model file: a round trip, and every way in which it can be damaged or foreign."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from aa4d.anchors.canonical import Anchors
from aa4d.capture.frame import frame_of
from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS
from aa4d.methods.adaanchor4d.model import AdaAnchor4D, blank_model
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.model_file import MODEL_VERSION, copy_model, load_model, read_tensors, save_model
from aa4d.motion.groups import Groups

CONFIG = ModelConfig(offsets=3, plane_dim=4, spatial_resolutions=(5, 9), temporal_resolution=6)


def write_model(path: Path, model: AdaAnchor4D, capture_folder: Path) -> Path:
    capture = read_capture(capture_folder)
    save_model(
        path,
        "adaanchor4d",
        model,
        is_static=False,
        capture=capture,
        frame=frame_of(capture),
        background=(0.1, 0.2, 0.3),
        training={"seconds": 1.0},
    )
    return path


@pytest.fixture
def model_path(toy_capture: Path, tmp_path: Path) -> Path:
    torch.manual_seed(0)
    anchors = Anchors(torch.randn(7, 3), torch.randn(7, 6), 3, 32, 32)
    path = tmp_path / "run" / "model.safetensors"
    path.parent.mkdir()
    return write_model(path, AdaAnchor4D(CONFIG, anchors), toy_capture)


def rewrite_header(path: Path, change: Any) -> None:
    header, tensors = read_tensors(path)
    change(header)
    save_file(tensors, str(path), metadata={"aa4d": json.dumps(header)})


def test_round_trip_keeps_every_tensor_and_the_frame(model_path: Path, toy_capture: Path) -> None:
    first, second = load_model(model_path), load_model(model_path)
    assert first.model.config == CONFIG
    for name, value in first.model.state_dict().items():
        assert torch.equal(value, second.model.state_dict()[name]), name
    assert first.frame.unit_m == pytest.approx(20.0)
    assert first.capture_folder == toy_capture.resolve()
    assert not first.is_static
    assert first.background == (0.1, 0.2, 0.3)
    header, _ = read_tensors(model_path)
    assert len(header["frames"]) == 10
    assert "truth" not in header["frames"][0]


def test_tensor_names_and_shapes_are_those_of_the_documented_format(model_path: Path) -> None:
    shapes = {name: tuple(value.shape) for name, value in load_file(str(model_path)).items()}
    assert shapes["anchors.position"] == (7, 3)
    assert shapes["anchors.offset"] == (7, 3, 3)
    assert shapes["field.planes.1.xy"] == (4, 9, 9)
    assert shapes["field.planes.1.zt"] == (4, 6, 9)
    assert shapes["warp.boundaries"] == (3, 65)
    assert shapes["acfa.output.weight"] == (6 * 4, 256)
    assert shapes["decoder_covariance.output.weight"] == (21, 32)
    documented = (Path(__file__).parents[2] / "docs/formats.md").read_text()
    for name in shapes:
        assert name.split(".")[0] in documented


def test_a_copy_elsewhere_still_finds_its_capture(model_path: Path, tmp_path: Path, toy_capture: Path) -> None:
    target = tmp_path / "a" / "b" / "model.safetensors"
    target.parent.mkdir(parents=True)
    copy_model(model_path, target)
    assert load_model(target).capture_folder == toy_capture.resolve()


@pytest.mark.parametrize("size", [0, 4, 8, 100, 5000])
def test_a_file_cut_short_is_refused(model_path: Path, size: int) -> None:
    model_path.write_bytes(model_path.read_bytes()[:size])
    with pytest.raises(InputError, match="not a whole safetensors file"):
        load_model(model_path)


@pytest.mark.parametrize(
    "content",
    [
        b"PK\x03\x04 a zip",
        b"\x80\x05 a pickle",
        b"\xff" * 64,
        struct.pack("<Q", 2**31) + b"{",
        struct.pack("<Q", 2) + b"[]",
    ],
)
def test_a_foreign_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.safetensors"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"model\.safetensors"):
        load_model(path)


def test_an_absent_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such model file"):
        load_model(tmp_path / "model.safetensors")


def test_safetensors_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    save_file({"weight": torch.zeros(2)}, str(path))
    with pytest.raises(InputError, match="not an AdaAnchor4D model"):
        load_model(path)


def test_a_newer_version_is_refused(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: h.update(version=MODEL_VERSION + 1))
    with pytest.raises(InputError, match="newer than this aa4d reads"):
        load_model(model_path)


@pytest.mark.parametrize(
    "change",
    [
        {"version": 0},
        {"training": 5.0},
        {"training": []},
        {"version": "1"},
        {"model_to_world": "abc"},
        {"model_to_world": [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        {"model_to_world": [[0] * 4] * 4},
        {"background": None},
        {"background": [float("nan")] * 3},
        {"stage": "finer"},
        {"capture": 7},
        {"training": {}},
    ],
)
def test_a_damaged_header_is_refused(model_path: Path, change: dict[str, Any]) -> None:
    rewrite_header(model_path, lambda h: h.update(change))
    with pytest.raises(InputError, match=r"model\.safetensors: .*(damaged|does not exist|finite number|is no object)"):
        load_model(model_path)


@pytest.mark.parametrize("change", [{}, {"offsets": -1}, {"offsets": 10**12}, {"bins": 10**11}, {"levels": 0}])
def test_an_incomplete_configuration_is_refused(model_path: Path, change: dict[str, int]) -> None:
    rewrite_header(model_path, lambda h: h["config"].update(change) if change else h.update(config=[]))
    with pytest.raises(InputError, match="config is wrong"):
        load_model(model_path)


def test_a_configuration_without_a_key_is_refused(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: h["config"].pop("offsets"))
    with pytest.raises(InputError, match="config is wrong"):
        load_model(model_path)


@pytest.mark.parametrize("name", AGGREGATIONS)
def test_every_aggregation_survives_the_file(toy_capture: Path, tmp_path: Path, name: str) -> None:
    config = replace(CONFIG, aggregation=name)
    model = AdaAnchor4D(config, Anchors(torch.randn(4, 3), torch.randn(4, 6), 3, 32, 32))
    path = write_model(tmp_path / "model.safetensors", model, toy_capture)
    loaded = load_model(path).model
    assert loaded.config == config
    for parameter, value in model.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[parameter]), parameter


def test_a_file_without_an_aggregation_is_acfa(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: h["config"].pop("aggregation"))
    assert load_model(model_path).model.config.aggregation == "acfa"


def test_an_unknown_variant_is_refused(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: h["config"].update(aggregation="attention"))
    with pytest.raises(InputError, match=r"aggregation 'attention' is unknown .*product"):
        load_model(model_path)


def test_tensors_that_do_not_fit_the_configuration_are_refused(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: h["config"].update(offsets=4))
    with pytest.raises(InputError, match="do not fit"):
        load_model(model_path)


@pytest.mark.parametrize("change", ["missing", "nan"])
def test_missing_and_nan_tensors_are_named(model_path: Path, change: str) -> None:
    header, tensors = read_tensors(model_path)
    if change == "missing":
        del tensors["encoder.weight"]
    else:
        tensors["encoder.weight"][0, 0] = float("nan")
    save_file(tensors, str(model_path), metadata={"aa4d": json.dumps(header)})
    with pytest.raises(InputError, match=r"encoder\.weight"):
        load_model(model_path)


def test_a_failed_write_leaves_the_old_file(model_path: Path, toy_capture: Path) -> None:
    before = model_path.read_bytes()
    capture = read_capture(toy_capture)
    model = load_model(model_path).model
    with pytest.raises(ValueError, match="not JSON compliant"):
        save_model(
            model_path,
            "adaanchor4d",
            model,
            is_static=False,
            capture=replace(capture, fps=float("nan")),
            frame=frame_of(capture),
            background=(0, 0, 0),
            training={},
        )
    assert model_path.read_bytes() == before
    assert sorted(p.name for p in model_path.parent.iterdir()) == ["model.safetensors"]


@pytest.mark.parametrize(("dlgd", "dacw"), [(False, True), (True, False), (False, False)])
def test_switched_off_parts_survive_the_file(toy_capture: Path, tmp_path: Path, dlgd: bool, dacw: bool) -> None:
    config = replace(CONFIG, dlgd=dlgd, dacw=dacw)
    model = blank_model(config, 4)
    torch.nn.init.normal_(model.anchors.feature)
    path = write_model(tmp_path / "model.safetensors", model, toy_capture)
    loaded = load_model(path).model
    assert loaded.config == config
    assert torch.equal(loaded.anchors.feature, model.anchors.feature)
    _, tensors = read_tensors(path)
    assert any(name.startswith("dlgd_") for name in tensors) == dlgd
    assert ("anchors.embedding_offset" in tensors) == dlgd


def test_a_file_that_does_not_say_has_dlgd_and_dacw(model_path: Path) -> None:
    rewrite_header(model_path, lambda h: (h["config"].pop("dlgd"), h["config"].pop("dacw")))
    assert load_model(model_path).model.config == CONFIG


def test_a_switch_that_disagrees_with_the_tensors_is_refused(toy_capture: Path, tmp_path: Path) -> None:
    model = blank_model(CONFIG, 4)
    model.warp.boundaries[:, 1:-1] *= 0.9
    path = write_model(tmp_path / "model.safetensors", model, toy_capture)
    rewrite_header(path, lambda h: h["config"].update(dacw=False))
    with pytest.raises(InputError, match="says dacw false"):
        load_model(path)
    rewrite_header(path, lambda h: h["config"].update(dacw="off"))
    with pytest.raises(InputError, match=r"config\.dacw is 'off'"):
        load_model(path)


@pytest.fixture
def riding_path(toy_capture: Path, tmp_path: Path) -> Path:
    """Version 2: of seven anchors four ride on two groups."""
    torch.manual_seed(0)
    model = AdaAnchor4D(CONFIG, Anchors(torch.randn(7, 3), torch.randn(7, 6), 3, 32, 32))
    shown = torch.tensor([[-2.0, -1, 2, 3], [0.1, 0.2, 0.6, 0.7]])
    groups = Groups(("van", "bus"), torch.randn(2, 6, 4), torch.randn(2, 4), shown, torch.tensor([0.0, 0, 1]))
    model.ride(groups, torch.tensor([-1, 0, 1, 1, -1, 0, -1]))
    path = tmp_path / "riding" / "model.safetensors"
    path.parent.mkdir()
    return write_model(path, model, toy_capture)


def test_groups_survive_the_round_trip_and_make_it_version_2(riding_path: Path, model_path: Path) -> None:
    model = load_model(riding_path).model
    assert model.groups is not None
    assert model.groups.names == ("van", "bus")
    assert model.anchors.group is not None
    assert model.anchors.group.tolist() == [-1, 0, 1, 1, -1, 0, -1]
    assert read_tensors(riding_path)[0]["version"] == 2
    assert all(value.dtype == torch.float32 for value in load_file(str(riding_path)).values())
    # A model that rides on nothing is one that older readers open.
    assert read_tensors(model_path)[0]["version"] == 1


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("anchors.group", torch.tensor([-1.0, 0, 1, 2, 0, 0, 0]), "names a group that is not there"),
        ("anchors.group", torch.tensor([-1.0, 0, 0.5, 1, 0, 0, 0]), "names a group that is not there"),
        ("groups.up", torch.zeros(3), "expected a unit vector"),
        ("groups.shown", torch.tensor([[0.0, 0.2, 0.1, 1], [0, 0, 1, 1]]), "times that go back"),
        ("groups.shown", torch.zeros(2, 3), "do not fit|times that go back"),
        ("groups.position", torch.zeros(2, 3, 3), "with C of at least 4"),
        ("groups.position", torch.zeros(3, 6, 3), r"expected \[2, C, 3\]"),
        ("groups.heading", torch.full((2, 6), torch.nan), "holds NaN or infinity"),
        ("groups.reference", None, "is missing"),
    ],
)
def test_damaged_groups_are_refused(riding_path: Path, name: str, value: torch.Tensor | None, says: str) -> None:
    header, tensors = read_tensors(riding_path)
    if value is None:
        del tensors[name]
    else:
        tensors[name] = value
    save_file(tensors, str(riding_path), metadata={"aa4d": json.dumps(header)})
    with pytest.raises(InputError, match=says):
        load_model(riding_path)


@pytest.mark.parametrize("groups", [None, 3, [{}], [{"name": 7}, {"name": "bus"}], "ab"])
def test_group_names_that_are_none_are_refused(riding_path: Path, groups: Any) -> None:
    rewrite_header(riding_path, lambda header: header.update(groups=groups))
    with pytest.raises(InputError, match=r"model\.safetensors"):
        load_model(riding_path)


def test_groups_in_a_file_of_version_1_are_refused(riding_path: Path) -> None:
    rewrite_header(riding_path, lambda header: header.update(version=1))
    with pytest.raises(InputError, match="version 1 knows no rigid groups, but the file holds some"):
        load_model(riding_path)

"""Reading the model file without Blender: what is refused, and how."""

import builtins
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from bad_model_files import BAD_FILES, OVERSIZED
from model_files import header_and_data, make_model, write_file, write_model

from addon.container import ModelFileError
from addon.field import anchor_positions, prepare
from addon.model import read_model


@pytest.mark.parametrize("kind", BAD_FILES)
def test_unusable_file_is_refused_in_one_sentence(kind: str, tmp_path: Path) -> None:
    write, words = BAD_FILES[kind]
    path = tmp_path / "model.safetensors"
    write(path)
    with pytest.raises(ModelFileError) as refusal:
        read_model(path)
    message = str(refusal.value)
    assert words in message
    assert path.name in message
    assert "\n" not in message
    assert message.endswith(".")
    assert len(message) < 200
    assert not hasattr(builtins, "aa4d_exploited")


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.safetensors", *make_model(4, frames=2))
    content = path.read_bytes()
    for length in np.linspace(0, len(content) - 1, 60).astype(int):
        path.write_bytes(content[:length])
        with pytest.raises(ModelFileError):
            read_model(path)


def test_memory_is_bounded_by_the_file(tmp_path: Path) -> None:
    """A header that promises terabytes asks for none."""
    header, data = header_and_data(*make_model(4))
    header["anchors.position"] = {"dtype": "F32", "shape": [2**40, 3], "data_offsets": [0, 12 * 2**40]}
    path = write_file(tmp_path / "model.safetensors", header, data)
    tracemalloc.start()
    with pytest.raises(ModelFileError):
        read_model(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * path.stat().st_size + 1_000_000


def test_evaluating_takes_no_memory_out_of_proportion(tmp_path: Path) -> None:
    OVERSIZED(tmp_path / "model.safetensors")
    model = read_model(tmp_path / "model.safetensors")
    with pytest.raises(ModelFileError, match="out of proportion"):
        prepare(model)


@pytest.mark.parametrize("stage", ["fine", "coarse"])
@pytest.mark.parametrize("dlgd", [True, False])
def test_reads_what_was_written(stage: str, dlgd: bool, tmp_path: Path) -> None:
    tensors, information = make_model(20, stage=stage, dlgd=dlgd)
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    assert set(model.tensors) == set(tensors)
    assert all(np.array_equal(model.tensors[name], tensors[name]) for name in tensors)
    assert model.static == (stage == "coarse")
    assert model.frame_count == len(information["frames"])
    assert model.fps == information["fps"]


def test_extra_tensors_are_left_alone(tmp_path: Path) -> None:
    tensors, information = make_model(20)
    tensors["notes.of.another.program"] = np.full(5, np.nan, np.float32)
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    assert "notes.of.another.program" not in model.tensors


def test_groups_are_read(tmp_path: Path) -> None:
    tensors, information = make_model(20, groups=3)
    groups = read_model(write_model(tmp_path / "model.safetensors", tensors, information)).groups
    assert groups is not None
    assert groups.names == ("car 1", "car 2", "car 3")
    np.testing.assert_array_equal(groups.of_anchor, tensors["anchors.group"])
    np.testing.assert_array_equal(groups.riders, np.flatnonzero(tensors["anchors.group"] >= 0))
    np.testing.assert_array_equal(groups.control[..., 3], tensors["groups.heading"])


def test_all_groups_may_be_gone(tmp_path: Path) -> None:
    tensors, information = make_model(20, groups=3)
    tensors["anchors.group"][:] = -1
    for name in [name for name in tensors if name.startswith("groups.") and name != "groups.up"]:
        tensors[name] = tensors[name][:0]
    information["groups"] = []
    field = prepare(read_model(write_model(tmp_path / "model.safetensors", tensors, information)))
    without = prepare(read_model(write_model(tmp_path / "other.safetensors", *make_model(20))))
    assert anchor_positions(field, 0.3).shape == anchor_positions(without, 0.3).shape

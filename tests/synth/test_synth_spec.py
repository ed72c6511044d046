"""The scene file: what is read, and what is refused and how."""

import copy
import dataclasses
import tomllib
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from synth.errors import InputError
from synth.spec import Scene, parse_scene, read_scene

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def table(tiny_scene: Path) -> dict[str, Any]:
    return copy.deepcopy(tomllib.loads(tiny_scene.read_text()))


def refusal(table: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        parse_scene(table, "x.toml")
    message = str(caught.value)
    assert message.startswith("x.toml: ")
    assert "\n" not in message
    return message


def test_shipped_scenes_are_valid() -> None:
    for path in sorted((ROOT / "scenes").rglob("*.toml")):
        assert read_scene(path).name == path.stem


def test_whole_numbers_are_accepted_where_numbers_are(table: dict[str, Any]) -> None:
    table["camera"]["hfov_deg"] = 60
    assert parse_scene(table, "x.toml").camera.hfov_deg == 60.0


def test_unknown_key_is_refused_with_the_nearest_one(table: dict[str, Any]) -> None:
    table["camera"]["hfov"] = 60.0
    message = refusal(table)
    assert "camera.hfov" in message
    assert "did you mean 'hfov_deg'" in message


def test_unknown_section_lists_what_is_allowed(table: dict[str, Any]) -> None:
    table["zeppelin"] = {}
    assert "street" in refusal(table)


@pytest.mark.parametrize("value", ["twelve", True, [12], 12.5])
def test_wrong_type_is_refused(table: dict[str, Any], value: object) -> None:
    table["time"]["frames"] = value
    message = refusal(table)
    assert "time.frames" in message
    assert "whole number" in message


def test_missing_road_is_refused(table: dict[str, Any]) -> None:
    del table["street"]
    assert "street: missing" in refusal(table)


@pytest.mark.parametrize("value", [0, -3, 1e9, float("nan"), float("inf")])
def test_out_of_range_names_the_range(table: dict[str, Any], value: float) -> None:
    table["time"]["fps"] = value
    assert "from 0.1 to 1000" in refusal(table)


def test_unknown_choice_names_the_choices(table: dict[str, Any]) -> None:
    table["vehicles"][0]["route"] = "west-eest"
    message = refusal(table)
    assert "vehicles[0].route" in message
    assert "did you mean 'west-east'" in message


def test_list_of_wrong_length_is_refused(table: dict[str, Any]) -> None:
    table["flight"]["centre_m"] = [0.0, 1.0]
    assert "flight.centre_m" in refusal(table)


def test_corner_given_twice_is_refused(table: dict[str, Any]) -> None:
    table["blocks"][1]["corner"] = table["blocks"][0]["corner"]
    assert "twice" in refusal(table)


@pytest.mark.parametrize("value", [float("-inf"), float("nan")])
def test_values_without_a_range_must_be_finite_too(table: dict[str, Any], value: float) -> None:
    table["signal"]["east_west_green_s"] = [[value, 2.0]]
    assert "signal.east_west_green_s" in refusal(table)


def test_a_byte_order_mark_is_no_part_of_the_scene(tiny_scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + tiny_scene.read_bytes())
    assert read_scene(path).name == read_scene(tiny_scene).name


def test_reversed_green_interval_is_refused(table: dict[str, Any]) -> None:
    table["signal"]["east_west_green_s"] = [[3, 2]]
    assert "signal.east_west_green_s" in refusal(table)


def test_unreadable_and_malformed_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_scene(tmp_path / "absent.toml")
    (tmp_path / "bad.toml").write_text("name = ")
    with pytest.raises(InputError, match="not valid TOML"):
        read_scene(tmp_path / "bad.toml")
    (tmp_path / "latin.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(InputError, match="UTF-8"):
        read_scene(tmp_path / "latin.toml")


def keys(cls: type) -> set[str]:
    """All keys under a section, nested ones included."""
    found = set()
    for name, hint in get_type_hints(cls).items():
        found.add(name)
        for option in (hint, *get_args(hint)):
            if dataclasses.is_dataclass(option):
                found |= keys(option)  # type: ignore[arg-type]
    return found


def test_every_key_is_documented() -> None:
    text = (ROOT / "docs" / "scenes.md").read_text()
    assert {key for key in keys(Scene) if f"`{key}`" not in text and f"`[{key}]`" not in text
            and f"`[[{key}]]`" not in text} == set()  # fmt: skip

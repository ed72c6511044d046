"""The scene file: what is read, and what is refused and how."""

import copy
import dataclasses
import math
import tomllib
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from synth.errors import InputError
from synth.flight import FLIGHTS
from synth.plan import make_plan
from synth.reference import reference
from synth.spec import Scene, parse_scene, read_scene
from synth.streets import STREETS

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
    scenes = ROOT / "scenes"
    for path in sorted({*scenes.rglob("*.toml")} - {*(scenes / "experiments").iterdir()}):
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
    assert "True" not in message, "that is how Python writes it, not TOML"


def test_missing_road_is_refused(table: dict[str, Any]) -> None:
    del table["street"]
    assert "street: missing" in refusal(table)


@pytest.mark.parametrize("value", [0, -3, 1e9, float("nan"), float("inf")])
def test_out_of_range_names_the_range(table: dict[str, Any], value: float) -> None:
    table["time"]["fps"] = value
    assert "from 0.1 to 1000" in refusal(table)


def test_unknown_choice_names_the_choices(table: dict[str, Any]) -> None:
    table["vehicles"][0]["kind"] = "vann"
    message = refusal(table)
    assert "vehicles[0].kind" in message
    assert "did you mean 'van'" in message


def test_list_of_wrong_length_is_refused(table: dict[str, Any]) -> None:
    table["flight"]["centre_m"] = [0.0, 1.0]
    assert "flight.centre_m" in refusal(table)


@pytest.mark.parametrize(("key", "names"), [("truth.passes", ["flow", "depth_z", "flow"]), ("exports", ["mot", "mot"])])
def test_names_given_twice_are_refused(table: dict[str, Any], key: str, names: list[str]) -> None:
    inner = table
    *sections, last = key.split(".")
    for section in sections:
        inner = inner.setdefault(section, {})
    inner[last] = names
    assert f"{key}: {names[-1]!r} is given twice; give each once." in refusal(table)


def test_corner_given_twice_is_refused(table: dict[str, Any]) -> None:
    table["blocks"][1]["corner"] = table["blocks"][0]["corner"]
    assert "twice" in refusal(table)


@pytest.mark.parametrize("value", [float("-inf"), float("nan")])
def test_values_without_a_range_must_be_finite_too(table: dict[str, Any], value: float) -> None:
    table["signal"]["east_west_green_s"] = [[value, 2.0]]
    message = refusal(table)
    assert "signal.east_west_green_s" in message
    assert f"must be a number, not {value}" in message


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, f"a = {'9' * 5000}"])
def test_nesting_and_numbers_without_end_are_no_scene(text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"scene\.toml: not valid TOML"):
        read_scene(path)


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


def test_the_reference_page_is_what_the_schema_says() -> None:
    assert (ROOT / "docs" / "scenes.md").read_text() == reference(), "run `python -m synth.reference > docs/scenes.md`"


def test_every_key_has_a_meaning() -> None:
    def check(cls: type) -> None:
        for each in dataclasses.fields(cls):
            kinds = each.metadata.get("kinds")
            for option in kinds.values() if kinds else ():
                check(option)
            hint = get_type_hints(cls)[each.name]
            inner = [option for option in (hint, *get_args(hint)) if dataclasses.is_dataclass(option)]
            for option in inner:
                check(option)  # type: ignore[arg-type]
            if not kinds and not inner and each.name not in ("kind", "effects"):
                assert each.metadata["meaning"], f"{cls.__name__}.{each.name}"

    check(Scene)


def test_world_offset_is_refused_with_the_reason(table: dict[str, Any]) -> None:
    table["flight"]["centre_m"] = [500_000.0, 5_000_000.0, 0.0]
    message = refusal(table)
    assert "flight.centre_m[0]" in message
    assert "relative to the scene" in message


@pytest.mark.parametrize("kind", FLIGHTS)
def test_every_flight_is_read_by_its_kind(table: dict[str, Any], kind: str) -> None:
    examples: dict[str, dict[str, Any]] = {
        "arc": table["flight"],
        "orbit": {"radius_m": 30, "altitude_m": 40},
        "line": {"from_m": [0, -50, 40], "to_m": [0, 50, 40]},
        "hover": {"position_m": [0, 0, 90], "yaw_deg": 0, "pitch_deg": -90},
        "spiral": {"radius_m": [60, 10], "altitude_m": [30, 100], "start_deg": 0, "sweep_deg": 400},
        "waypoints": {"points_m": [[0, -50, 40], [20, 0, 50], [0, 50, 40]]},
    }
    table["flight"] = {**examples[kind], "kind": kind}
    assert parse_scene(table, "x.toml").flight.kind == kind


def test_key_of_another_kind_is_refused(table: dict[str, Any]) -> None:
    table["flight"]["turns"] = 2
    assert "flight.turns: unknown key" in refusal(table)


def test_unknown_kind_names_the_kinds(table: dict[str, Any]) -> None:
    table["street"]["kind"] = "roundabuot"
    message = refusal(table)
    assert "did you mean 'roundabout'" in message
    del table["street"]["kind"]
    assert "street.kind: missing" in refusal(table)


def test_flight_below_what_it_looks_at_is_refused(table: dict[str, Any]) -> None:
    table["flight"]["centre_m"] = [0, 0, 40]
    assert "above the center" in refusal(table)


def test_lights_where_there_are_none_are_refused(table: dict[str, Any]) -> None:
    table["street"] = {"kind": "roundabout"}
    assert "no traffic lights" in refusal(table)


def test_route_that_the_street_does_not_have_names_those_that_it_has(table: dict[str, Any]) -> None:
    table["vehicles"][0]["route"] = "west-eest"
    with pytest.raises(InputError, match=r"vehicles\[0\].route: 'west-eest' must be one of .*west-east"):
        make_plan(parse_scene(table, "x.toml"))


def test_heterogeneity_family_differs_in_its_knob_alone() -> None:
    scenes = [read_scene(path) for path in sorted((ROOT / "scenes" / "heterogeneity").glob("*.toml"))]
    assert len(scenes) >= 3
    for scene in scenes[1:]:
        for name in ("time", "camera", "flight", "street", "blocks", "greenery", "light", "render", "seed"):
            assert getattr(scene, name) == getattr(scenes[0], name), (scene.name, name)


def test_arc_scenes_span_the_range_of_drone_footage() -> None:
    scenes = [read_scene(path) for path in sorted((ROOT / "scenes").glob("arc*.toml"))]
    assert len(scenes) == 10
    assert {scene.street.kind for scene in scenes} == set(STREETS)
    altitudes = [scene.flight.altitude_m for scene in scenes]  # type: ignore[attr-defined]
    pitches = [math.degrees(math.atan2(s.flight.altitude_m - s.flight.centre_m[2], s.flight.radius_m)) for s in scenes]  # type: ignore[attr-defined]
    assert min(altitudes) < 25
    assert max(altitudes) > 110
    assert min(pitches) < 35
    assert max(pitches) == pytest.approx(90)

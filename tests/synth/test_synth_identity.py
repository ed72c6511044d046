"""A capture's identity changes with every leaf of its scene, and with nothing else."""

import dataclasses
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from synth.capture import Folder
from synth.costs import Costs
from synth.effects import NAMES, choose
from synth.export.index import index
from synth.identity import capture_identity
from synth.plan import Plan, document, make_plan
from synth.spec import Asset, Flow, Scene, parse_scene, read_scene
from synth.traffic.tracks import TrackTable

FILES = {"frames/000000.png": "00"}  # frames that are equal, whatever the scene


@pytest.fixture(scope="module")
def plan(tiny_scene: Path) -> Plan:
    return make_plan(read_scene(tiny_scene))


def identity_of(plan: Plan, blender: str = "4.5") -> dict[str, Any]:
    planned = document(plan, blender)
    return capture_identity(index(plan, Folder(Path()), planned["generator"], {}), FILES, {"plan": planned["sha256"]})


def full(scene: Scene) -> Scene:
    """Every table that a scene may have, with something in it."""
    return dataclasses.replace(
        scene,
        flows=(Flow(per_hour=100.0),),
        tracks=TrackTable(file="tracks.csv", format="metres"),
        assets=(Asset(kind="van", file="van.glb"),),
        effects={e.name: dataclasses.asdict(e.settings) for e in choose({name: {} for name in NAMES}, "x")},
    )


def changed_leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The value once for each of its leaves, with another leaf in that place; nothing of an optional table is left."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            for where, other in changed_leaves(getattr(value, field.name), f"{path}.{field.name}"):
                yield where, dataclasses.replace(value, **{field.name: other})
    elif isinstance(value, dict):
        for key in value:
            for where, other in changed_leaves(value[key], f"{path}.{key}"):
                yield where, {**value, key: other}
    elif isinstance(value, tuple):
        yield f"{path}[]", (*value, value[0] if value else "new")
        for i, item in enumerate(value):
            for where, other in changed_leaves(item, f"{path}[{i}]"):
                yield where, (*value[:i], other, *value[i + 1 :])
    elif isinstance(value, bool):
        yield path, not value
    elif isinstance(value, int | float):
        yield path, value + 1e-9 if isinstance(value, float) else value + 1
    elif isinstance(value, str):
        yield path, value + "x"
    else:
        yield path, "something"


def test_each_leaf_of_a_scene_changes_the_identity_though_the_frames_are_equal(plan: Plan) -> None:
    scene = full(plan.scene)
    # What follows from the scene stays as it was: the scene itself must make the difference.
    nobody = SimpleNamespace(instances=(), members=tuple, object_to_world=lambda _: np.zeros((0, 4, 4)))
    city = SimpleNamespace(digest=lambda: "")
    whole = dataclasses.replace(plan, scene=scene, fleet=nobody, cast=nobody, city=city)
    seen = {json.dumps(identity_of(whole)): "the scene as it is"}
    leaves = list(changed_leaves(scene))
    for where, other in leaves:
        text = json.dumps(identity_of(dataclasses.replace(whole, scene=other)))
        assert text not in seen, f"{where} gives the identity of {seen[text]}"
        seen[text] = where
    named = {where.split(".")[1].split("[")[0] for where, _ in leaves}
    assert named == {field.name for field in dataclasses.fields(Scene)}
    assert len(leaves) > 100


def test_the_same_scene_planned_again_has_the_same_identity(tiny_scene: Path, plan: Plan) -> None:
    again = make_plan(read_scene(tiny_scene))
    assert identity_of(again) == identity_of(plan)
    assert identity_of(again, blender="5.0") != identity_of(plan)


def test_haze_samples_and_light_are_told_apart(tiny_scene: Path) -> None:
    table = tomllib.loads(tiny_scene.read_text())
    haze = {"effects": {"haze": {"visibility_m": 600.0}}}
    plans = [
        make_plan(parse_scene(table | haze | tables, "x"))
        for tables in (
            {},
            {"effects": {"haze": {"visibility_m": 50.0}}},
            {"render": {"samples": 1}},
            {"light": {"sun_strength": 0.0}},
        )
    ]
    indices = [index(plan, Folder(Path()), {}, {}) for plan in plans]
    assert all(content == indices[0] for content in indices)  # nothing in the index tells them apart
    assert len({json.dumps(identity_of(plan)) for plan in plans}) == 4


def test_content_and_plan_are_both_compared(plan: Plan) -> None:
    content = index(plan, Folder(Path()), {}, {})
    one = capture_identity(content, FILES, {"plan": "a"})
    assert capture_identity({**content, "generator": {"by": "hand"}, "identity": one}, FILES, {"plan": "a"}) == one
    for other in (
        capture_identity(content, FILES, {"plan": "b"}),
        capture_identity(content, {"frames/000000.png": "01"}, {"plan": "a"}),
        capture_identity({**content, "fps": 3.0}, FILES, {"plan": "a"}),
    ):
        assert other != one


def test_seconds_of_an_interrupted_stage_count_and_its_frame_does_not(tmp_path: Path) -> None:
    costs = Costs(tmp_path / "cost.json")

    def interrupted() -> None:
        with costs.stage("picture", "000001"), costs.effect("haze"):
            raise KeyboardInterrupt

    with costs.stage("picture", "000000"):
        pass
    before = costs.stages["picture"]
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert costs.stages["picture"] >= before
    assert list(costs.effects) == ["haze"]
    assert list(costs.frames) == ["000000"]

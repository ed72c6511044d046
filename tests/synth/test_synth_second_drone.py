"""Two drones over the same traffic."""

import importlib.util
import json
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from synth.errors import InputError
from synth.plan import document, make_plan
from synth.spec import Scene, read_scene

Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]
FLIGHT = """
[second_flight]
kind = "hover"
position_m = [20.0, -12.0, 30.0]
yaw_deg = 150.0
pitch_deg = -50.0
"""


@pytest.fixture
def scene_file(tiny_scene: Path, tmp_path: Path) -> Path:
    path = tmp_path / "two.toml"
    path.write_text(tiny_scene.read_text() + FLIGHT)
    return path


def test_both_see_the_same_world_at_the_same_times_from_elsewhere(scene_file: Path) -> None:
    scene = read_scene(scene_file)
    first, second = make_plan(scene), make_plan(scene, drone="second")
    assert [frame.time_s for frame in first.frames] == [frame.time_s for frame in second.frames]
    assert {frame.split for frame in second.frames} == {"test"}
    assert first.city.digest() == second.city.digest()
    one, two = document(first, "x"), document(second, "x")
    assert one["trajectories_sha256"] == two["trajectories_sha256"]
    assert one["sha256"] != two["sha256"]
    assert not np.allclose(first.frames[0].viewmat, second.frames[0].viewmat)


def test_the_second_drone_has_true_poses_and_sways_as_effects_say(scene_file: Path) -> None:
    effects = "\n[effects.pose_noise]\nhorizontal_m = 0.3\n[effects.position_sway]\nrms_m = 0.5\n"
    scene_file.write_text(scene_file.read_text() + effects)
    scene = read_scene(scene_file)
    names = [effect.name for effect in make_plan(scene, drone="second").effects]
    assert names == ["position_sway"]
    still = make_plan(read_scene_without_effects(scene_file), drone="second")
    assert not np.allclose(make_plan(scene, drone="second").frames[2].viewmat, still.frames[2].viewmat)


def read_scene_without_effects(path: Path) -> Scene:
    path.write_text(path.read_text().partition("[effects")[0])
    return read_scene(path)


def test_a_scene_without_one_is_planned_as_ever(tiny_scene: Path) -> None:
    scene = read_scene(tiny_scene)
    planned = document(make_plan(scene), "x")
    assert "second_flight" not in planned["scene"]
    assert "drone" not in planned
    with pytest.raises(InputError, match="second_flight: missing"):
        make_plan(scene, drone="second")


def test_it_is_rendered_beside_the_first(scene_file: Path, capture: Path, flyover: Command, tmp_path: Path) -> None:
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("needs the bpy module")
    out = tmp_path / "capture"
    result = flyover([scene_file, "--out", out])
    assert result.returncode == 0, result.stderr
    alone, beside = (json.loads((folder / "checksums.json").read_text()) for folder in (capture, out))
    assert alone == beside, "the first drone's files are the same bytes with and without the second"
    second = json.loads((out / "second/capture.json").read_text())
    assert len(second["frames"]) == 6
    tracks = [np.load(folder / "truth/tracks.npz")["object_to_world"] for folder in (out, out / "second")]
    assert np.array_equal(*tracks)
    pictures = [(folder / "frames/000002.png").read_bytes() for folder in (out, out / "second")]
    assert pictures[0] != pictures[1]
    again = flyover([scene_file, "--out", out])
    assert again.stdout.count("complete already") == 2

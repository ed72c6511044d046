"""Time, bakes and views of the packaged extension, live and baked."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, go_to, imported, input_path, played, set_input, srgb
from model_files import make_model, write_model

FRAMES = 5
TIME = "AdaAnchor4D Time"


@pytest.mark.parametrize("baked", [False, True])
@pytest.mark.parametrize(
    ("settings", "frames_and_ranks"),
    [
        ({"Speed": 2.0}, {1: 0, 2: 2, 2.25: 2.5, 9: 4}),
        ({"Start Frame": 3.0, "Reverse": True}, {3: 4, 4.5: 2.5, 7: 0}),
        ({"Outside the Clip": "Loop"}, {5.5: 4, 6: 0, 12.5: 1.5, -1: 3}),
        ({"Outside the Clip": "Back and Forth"}, {6: 3, 9: 0, 10.5: 1.5}),
        ({"Set Time by Hand": True, "Time": 3.5}, {1: 2.5, 40: 2.5}),
    ],
)
def test_clip_time_live_and_baked(
    bpy: Any,
    extension: str,
    model_path: Path,
    baked: bool,
    settings: dict[str, Any],
    frames_and_ranks: dict[float, float],
) -> None:
    obj = imported(bpy, model_path)
    ranks = [float(rank) for rank in frames_and_ranks.values()]
    if baked:  # linear between the keys
        whole = clip_positions(bpy, obj, [0, 1, 2, 3, 4])
        low = np.minimum(np.array(ranks).astype(int), 3)
        share = (np.array(ranks) - low)[:, None, None]
        expected = (1 - share) * whole[low] + share * whole[low + 1]
        assert bpy.ops.aa4d.bake() == {"FINISHED"}
    else:
        expected = clip_positions(bpy, obj, ranks)
    for name, value in settings.items():
        set_input(extension, obj, TIME, name, value)
    for frame, positions in zip(frames_and_ranks, expected, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], positions, atol=2e-4)


@pytest.mark.parametrize("baked", [False, True])
def test_time_set_by_hand_can_be_keyed(bpy: Any, extension: str, model_path: Path, baked: bool) -> None:
    """Animation is evaluated before the points are: what is shown is never a frame late."""
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 2, 4])
    if baked:
        bpy.ops.aa4d.bake()
    set_input(extension, obj, TIME, "Set Time by Hand", True)
    for frame, time in ((1, 1.0), (11, 5.0)):
        set_input(extension, obj, TIME, "Time", time)
        obj.keyframe_insert(input_path(extension, obj, TIME, "Time"), frame=frame)
    curve = obj.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0]
    for point in curve.keyframe_points:
        point.interpolation = "LINEAR"
    for frame, positions in zip((1, 6, 11), expected, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], positions, atol=2e-4)
    if not baked:
        assert bpy.ops.aa4d.bake() == {"FINISHED"}  # the animation survives the change of the group
        go_to(bpy, 6)
        np.testing.assert_allclose(played(bpy, obj)["position"], expected[1], atol=2e-4)


def test_input_changes_show_without_a_change_of_frame(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [3])[0]
    go_to(bpy, 1)
    set_input(extension, obj, TIME, "Start Frame", -2.0)
    np.testing.assert_allclose(attribute(obj.data, "position"), expected, atol=1e-6)


def test_bake_of_a_range_and_with_few_keys(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    whole = clip_positions(bpy, obj, [0, 1, 2, 3, 4])
    assert bpy.ops.aa4d.bake(use_range=True, first=2, last=4) == {"FINISHED"}
    for frame, rank in ((1, 1), (2, 1), (3, 2), (4, 3), (5, 3)):  # the ends of the range hold
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], whole[rank], atol=1e-4)
    assert bpy.ops.aa4d.bake(step=3) == {"FINISHED"}  # over the bake before: keys at ranks 0, 2 and 4
    keys = sorted(a.name for a in obj.data.attributes if a.name.startswith("aa_x_"))
    assert keys == ["aa_x_0000", "aa_x_0001", "aa_x_0002"]
    for frame in (1, 3, 5):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], whole[frame - 1], atol=1e-4)
    go_to(bpy, 2)
    np.testing.assert_allclose(played(bpy, obj)["position"], (whole[0] + whole[2]) / 2, atol=1e-4)
    with pytest.raises(RuntimeError, match="must not end before it begins"):
        bpy.ops.aa4d.bake(use_range=True, first=4, last=2)
    with pytest.raises(RuntimeError, match="5 frames"):
        bpy.ops.aa4d.bake(use_range=True, first=6, last=9)


def test_cancelled_bake_leaves_everything(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    before = sorted(a.name for a in obj.data.attributes)
    bake = importlib.import_module(f"{extension}.bake")
    work = bake.bake(obj, bpy.context.scene, bake.BakeOptions(inspection=True))
    assert next(work) == (1, FRAMES)
    assert len(obj.data.attributes) > len(before)
    work.close()
    assert sorted(a.name for a in obj.data.attributes) == before
    assert obj.aa4d.playback == "BAKED"


def test_bake_runs_as_a_person_sees_it(bpy: Any, extension: str, model_path: Path) -> None:
    """The modal operator, driven by hand: ticks until done, and Esc."""
    from types import SimpleNamespace
    from unittest.mock import MagicMock

    obj = imported(bpy, model_path)
    operators = importlib.import_module(f"{extension}.operators")
    bake = importlib.import_module(f"{extension}.bake")
    for cancel in (True, False):
        operator = MagicMock()
        operator.work = bake.bake(obj, bpy.context.scene, bake.BakeOptions())
        operator._end = lambda _context, _kind, _message, result: result
        context = MagicMock()
        tick, escape = SimpleNamespace(type="TIMER"), SimpleNamespace(type="ESC")
        assert operators.Bake.modal(operator, context, tick) == {"RUNNING_MODAL"}
        if cancel:
            assert operators.Bake.modal(operator, context, escape) == {"CANCELLED"}
            assert obj.aa4d.playback == "LIVE"
            assert not [a.name for a in obj.data.attributes if "unfinished" in a.name]
            continue
        results = [operators.Bake.modal(operator, context, tick) for _ in range(FRAMES)]
        assert results[-1] == {"FINISHED"}
        assert obj.aa4d.playback == "BAKED"


def test_view_follows_the_active_camera_or_is_frozen(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path, view="ACTIVE", set_up_scene=True)
    bpy.context.scene.camera.animation_data_clear()
    bpy.context.scene.camera.location = (30, -60, 20)
    go_to(bpy, 3)
    here = attribute(obj.data, "aa_color")
    bpy.context.scene.camera.location = (90, -20, 5)
    bpy.context.view_layer.update()
    there = attribute(obj.data, "aa_color")
    assert np.abs(here - there).max() > 0.05
    # Moving the points as well leaves nothing changed between the two.
    obj.location = (10, 20, 30)
    bpy.context.scene.camera.location = (40, -40, 50)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), here, atol=1e-4)
    assert bpy.ops.aa4d.freeze_view() == {"FINISHED"}
    bpy.context.scene.camera.location = (-90, 20, 5)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), here, atol=1e-4)


def test_baked_view_follows_the_animated_camera(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path, view="ACTIVE", set_up_scene=True)
    live = []
    for frame in (1, 3, 5):
        go_to(bpy, frame)
        live.append(srgb(played(bpy, obj)["aa_color"][:, :3]))
    go_to(bpy, 2)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert bpy.context.scene.frame_current == 2
    for frame, expected in zip((1, 3, 5), live, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(srgb(played(bpy, obj)["aa_color"][:, :3]), expected, atol=1.01 / 255)


def test_frames_are_quick_while_the_timeline_plays_and_exact_where_it_stops(
    bpy: Any, extension: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    playback = importlib.import_module(f"{extension}.playback")
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", *make_model(60, 40)))
    go_to(bpy, 13)
    exact = attribute(obj.data, "position")
    monkeypatch.setattr(playback, "is_playing", lambda: True)
    go_to(bpy, 12)
    go_to(bpy, 13)
    played = attribute(obj.data, "position")
    assert 0 < np.abs(played - exact).max() < 0.02 * np.ptp(exact, axis=0).max()
    assert not playback.quick_errors_m
    monkeypatch.setattr(playback, "is_playing", lambda: False)
    for stopped in bpy.app.handlers.animation_playback_post:
        if stopped.__module__.startswith(extension):
            stopped(bpy.context.scene)
    np.testing.assert_array_equal(attribute(obj.data, "position"), exact)
    off = np.linalg.norm(played - exact, axis=1)
    assert 0 < playback.quick_errors_m[obj.session_uid] <= off.max()

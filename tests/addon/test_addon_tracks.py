"""Track files in the packaged extension: the Gaussians of any method, played, inspected, baked and exported like a
model's."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from driving import attribute, drawn, go_to, imported, played, read_ply, set_input, srgb
from model_files import make_model, write_model
from PIL import Image
from track_files import APPEAR, COUNT, FADE, FRAMES, RIDE, WAY_M, Parts, half_turn, make_track, rest, write_track

TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"


@pytest.fixture
def track_path(tmp_path: Path) -> Path:
    """A track file, in a folder called flight."""
    folder = tmp_path / "flight"
    folder.mkdir()
    return write_track(folder / "track.safetensors", *make_track())


def expected_at(t: float) -> dict[str, np.ndarray]:
    """The motion that the file was written from; of what it does not do evenly, the mixture of the keys around t."""
    values = rest()
    values["position"][RIDE, 0] += WAY_M * t
    before, share = divmod(t * (FRAMES - 1), 1)
    mixed = (1 - share) * half_turn(before / (FRAMES - 1)) + share * half_turn((before + 1) / (FRAMES - 1))
    values["rotation"][RIDE] = mixed / np.linalg.norm(mixed)
    values["opacity"][APPEAR] = 0.8 * np.clip(t * (FRAMES - 1) - 1, 0, 1)
    values["color"][FADE] = t
    return values


def assert_shows(found: dict[str, np.ndarray], t: float) -> None:
    values = expected_at(t)
    there = values["opacity"][:, 0] > 0
    scales = np.exp(values["log_scale"]) * there[:, None]
    largest = np.sort(scales, axis=1)[:, 1:]
    np.testing.assert_allclose(found["position"], values["position"], atol=3e-4)
    np.testing.assert_allclose(srgb(found["aa_color"][:, :3]), values["color"], atol=4 / 255)
    np.testing.assert_allclose(found["aa_opacity"], values["opacity"][:, 0], atol=2.5 / 255)
    np.testing.assert_allclose(found["aa_radius"], 1.5 * np.sqrt(largest.prod(axis=1)), rtol=1e-4)
    np.testing.assert_allclose(found["aa_scale"], scales, rtol=1e-4)
    np.testing.assert_allclose(np.abs((found["aa_rotation"] * values["rotation"]).sum(axis=1)), 1, atol=1e-6)


@pytest.mark.parametrize("frame", [1, 2, 2.5, 4.75, 9])
def test_live_track_follows_its_keys(bpy: Any, track_path: Path, frame: float) -> None:
    obj = imported(bpy, track_path)
    assert (obj.name, len(obj.data.vertices), obj.aa4d.carrier) == ("flight", COUNT, "GAUSSIANS")
    go_to(bpy, frame)
    assert_shows({name: attribute(obj.data, name) for name in played(bpy, obj)}, min((frame - 1) / (FRAMES - 1), 1))


def test_baked_track_equals_live_and_needs_no_file(bpy: Any, track_path: Path) -> None:
    obj = imported(bpy, track_path, bake=True)
    track_path.unlink()
    for frame in (1, 3, 4.5, 5):
        go_to(bpy, frame)
        assert_shows(played(bpy, obj), (frame - 1) / (FRAMES - 1))


def test_colours_of_a_track_do_not_follow_a_camera(bpy: Any, extension: str, track_path: Path) -> None:
    obj = imported(bpy, track_path, view="ACTIVE", set_up_scene=True)
    playback = importlib.import_module(f"{extension}.playback")
    before = obj.data["aa_stamp"], attribute(obj.data, "aa_color")
    bpy.context.scene.camera.animation_data_clear()
    bpy.context.scene.camera.location = (0, 0, 100)
    bpy.context.view_layer.update()
    assert obj.data["aa_stamp"] == before[0]
    np.testing.assert_array_equal(attribute(obj.data, "aa_color"), before[1])
    assert not playback.problems


def test_a_track_that_is_saved_plays_on(bpy: Any, track_path: Path, tmp_path: Path) -> None:
    imported(bpy, track_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    obj = bpy.data.objects["flight"]
    go_to(bpy, 3.5)
    assert_shows({name: attribute(obj.data, name) for name in played(bpy, obj)}, 2.5 / (FRAMES - 1))
    assert bpy.ops.aa4d.set_up_compositing(mode="PLATE") == {"FINISHED"}


def test_looks_and_ghosts_of_a_track(bpy: Any, extension: str, track_path: Path) -> None:
    obj = imported(bpy, track_path)
    modifiers = importlib.import_module(f"{extension}.modifiers")
    look = "Native Splats" if bpy.app.version >= (5, 3) else "Gaussians"
    assert modifiers.get(obj.modifiers[LOOK], "Look") == look
    set_input(extension, obj, LOOK, "Look", "Points")
    set_input(extension, obj, LOOK, "Minimum Opacity", 0.0)
    go_to(bpy, 1)
    assert (drawn(bpy, obj)["radius"] == 0).sum() == len(APPEAR)  # what is not there is not drawn at any opacity
    set_input(extension, obj, TIME, "Trail", 2)
    go_to(bpy, 4)
    assert len(drawn(bpy, obj)["position"]) == COUNT + 2 * len(RIDE)


@pytest.mark.parametrize("baked", [False, True])
def test_quantities_of_a_track_are_those_of_its_motion(bpy: Any, extension: str, track_path: Path, baked: bool) -> None:
    obj = imported(bpy, track_path, look="Points")
    if baked:
        assert bpy.ops.aa4d.bake(inspection=True) == {"FINISHED"}
    fps = make_track()[1]["fps"]
    for frame in (1, 3):
        for name, quantity, value in (
            ("Speed", "aa_speed", WAY_M / (FRAMES - 1) * fps),
            ("Displacement", "aa_displacement", WAY_M * (frame - 1) / (FRAMES - 1)),  # from the first key
        ):
            set_input(extension, obj, LOOK, "Colour By", name)
            go_to(bpy, frame)
            obj.modifiers[LOOK].show_viewport = False
            found = attribute(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data, quantity)
            np.testing.assert_allclose(found, np.where(np.arange(COUNT) < 10, value, 0), atol=2e-3 * max(value, 1))
            obj.modifiers[LOOK].show_viewport = True
    assert not [a.name for a in obj.data.attributes if a.name.startswith("aa_w")]


def test_what_a_track_lacks_is_told_or_hidden(bpy: Any, extension: str, track_path: Path) -> None:
    panel = importlib.import_module(f"{extension}.panel")
    obj = imported(bpy, track_path, look="Points")
    for shown in ("Plane Weight", "Motion Share"):
        set_input(extension, obj, LOOK, "Colour By", shown)
        go_to(bpy, 3)
    texts: list[str] = []
    layout = MagicMock()
    for part in (layout, layout.column.return_value, layout.row.return_value, layout.box.return_value):
        part.column.return_value = layout.column.return_value
        part.label.side_effect = lambda text, **_: texts.append(text)
        part.operator.side_effect = lambda name, **_: texts.append(name) or MagicMock()
    for cls in (panel.ImportPanel, panel.TimePanel, panel.LookPanel, panel.InspectionPanel, panel.OutputPanel):
        cls.draw(SimpleNamespace(layout=layout, draw_legend=lambda *_: None), bpy.context)
    told = " ".join(texts)
    assert "the same from everywhere" in told
    assert "has no planes" in told
    assert not {"Seen From", "aa4d.freeze_view", "aa4d.add_grid"} & set(texts)
    assert not bpy.ops.aa4d.freeze_view.poll()
    with pytest.raises(RuntimeError, match=r"track\.safetensors is a track file, which has no field"):
        bpy.ops.aa4d.add_grid()
    assert bpy.ops.aa4d.measure_selection() == {"FINISHED"}
    assert bpy.ops.aa4d.bake() == {"FINISHED"}


def test_vehicles_of_a_track_have_their_colour(bpy: Any, extension: str, tmp_path: Path) -> None:
    obj = imported(bpy, write_track(tmp_path / "track.safetensors", *make_track(groups=True)), look="Points")
    assert len(bpy.data.meshes) == 1
    np.testing.assert_array_equal(attribute(obj.data, "aa_group"), np.where(np.arange(COUNT) < 10, 0, -1))
    set_input(extension, obj, LOOK, "Colour By", "Vehicle")
    assert len(np.unique(drawn(bpy, obj)["aa_color"].round(3), axis=0)) == 2


def test_camera_footage_and_activity_of_a_track_are_the_captures(bpy: Any, tmp_path: Path) -> None:
    """The camera is that of a model of this clip; a picture that is persistent on the left labels what is there."""
    capture = tmp_path / "capture"
    (capture / "truth" / "activity").mkdir(parents=True)
    (capture / "frames").mkdir()
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    labels = np.zeros((180, 320), np.uint8)
    labels[:, :160] = 2
    tensors, information = make_track()
    information["capture"] = "capture"
    for frame in information["frames"]:
        frame["viewmat"] = [[1, 0, 0, -30], [0, -1, 0, -20], [0, 0, -1, 60], [0, 0, 0, 1]]  # from straight above
        Image.fromarray(labels).save(capture / "truth" / "activity" / f"{frame['name']}.png")
        Image.fromarray(np.zeros((180, 320, 3), np.uint8)).save(capture / frame["image"])
    obj = imported(bpy, write_track(tmp_path / "track.safetensors", tensors, information))
    camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
    np.testing.assert_allclose(camera.location, [30, -20, 60], atol=1e-4)
    assert camera.data.lens == pytest.approx(260 * 36 / 320)
    assert camera.data.background_images[0].image.source == "SEQUENCE"
    assert bpy.context.scene.render.fps / bpy.context.scene.render.fps_base == pytest.approx(29.97)
    assert bpy.ops.aa4d.label_activity() == {"FINISHED"}
    found = attribute(obj.data, "aa_activity")
    place = rest()["position"]
    column = 260 * (place[:, 0] - 30) / (60 - place[:, 2]) + 166.5
    stands = np.arange(10, COUNT)
    np.testing.assert_array_equal(found[stands], np.where(column < 160, 2, 0)[stands])


def test_a_track_is_exported_as_it_is_shown(bpy: Any, track_path: Path, tmp_path: Path) -> None:
    imported(bpy, track_path)
    go_to(bpy, 2)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "out.ply")) == {"FINISHED"}
    vertex = read_ply(tmp_path / "out.ply")
    values = expected_at(0.25)
    there = values["opacity"][:, 0] > 0
    places = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(places, values["position"][there], atol=3e-4)
    np.testing.assert_allclose(vertex["scale_1"], values["log_scale"][there, 1], atol=1e-4)
    if bpy.app.build_options.usd:
        assert bpy.ops.aa4d.export_usd(filepath=str(tmp_path / "out.usdc"), use_range=True) == {"FINISHED"}
        assert (tmp_path / "out.usdc").stat().st_size > 1000


def test_a_track_and_a_model_do_not_take_each_others_place(bpy: Any, track_path: Path, tmp_path: Path) -> None:
    model_path = write_model(tmp_path / "model.safetensors", *make_model(60, FRAMES))
    obj = imported(bpy, track_path)
    with pytest.raises(RuntimeError, match=r"is a model file, and flight shows a track file; import it anew"):
        bpy.ops.aa4d.relink(filepath=str(model_path))
    tensors, information = make_track()
    tensors["position.rest"] = tensors["position.rest"] + np.float32(2)
    assert bpy.ops.aa4d.relink(filepath=str(write_track(tmp_path / "new.safetensors", tensors, information)))
    found = attribute(obj.data, "position")
    np.testing.assert_allclose(found[10:], rest()["position"][10:] + 2, atol=1e-4)
    imported(bpy, model_path, carrier="GAUSSIANS")
    with pytest.raises(RuntimeError, match=r"is a track file, and .* shows a model file"):
        bpy.ops.aa4d.relink(filepath=str(track_path))


Change = Callable[[dict[str, Any], dict[str, Any]], object]
HOSTILE: dict[str, tuple[Change, str]] = {
    "newer": (lambda _, info: info.update(version=2), "track file of version 2"),
    "no groups list": (lambda _, info: info.update(groups=3), "groups must be a list"),
    "a group that is not there": (
        lambda t, info: t.update(group=np.full(COUNT, 1, np.int32)) or info.update(groups=[{"name": "car"}]),
        "names a group that is not there",
    ),
    "groups without members": (lambda _, info: info.update(groups=[{}]), "lacks the tensor group"),
    "too far away": (lambda t, _: t["position.box"].__setitem__((0, 1, 0), 1e30), "from the origin"),
    "a box that overflows": (lambda t, _: t["position.box"].__setitem__(0, [[-3e38] * 3, [3e38] * 3]), "inf m from"),
    "sizes that overflow": (lambda t, _: t["log_scale.rest"].fill(1e4), "not finite"),
    "no Gaussians": (lambda t, _: t.update(ids=t["ids"][:0]), "holds no Gaussians"),
    "keys of another type": (lambda t, _: t.update({"color.keys": t["color.rest"]}), "lacks the tensor color.keys"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_unusable_track_gives_one_report_line(bpy: Any, kind: str, tmp_path: Path, capfd: Any) -> None:
    change, words = HOSTILE[kind]
    parts: Parts = make_track()
    change(*parts)
    path = write_track(tmp_path / "track.safetensors", *parts)
    with pytest.raises(RuntimeError, match=words) as refusal:
        bpy.ops.aa4d.import_model(filepath=str(path))
    assert len(str(refusal.value).strip().splitlines()) == 1
    assert not bpy.data.objects
    assert not bpy.data.meshes
    output = "".join(capfd.readouterr())
    assert "Traceback" not in output
    assert "Warning" not in output


def test_a_track_cut_short_is_refused(bpy: Any, track_path: Path) -> None:
    content = track_path.read_bytes()
    for length in (0, 7, 100, len(content) // 2, len(content) - 1):
        track_path.write_bytes(content[:length])
        with pytest.raises(RuntimeError, match=r"cut short|not a safetensors file"):
            bpy.ops.aa4d.import_model(filepath=str(track_path))
        assert not bpy.data.objects


def test_a_model_of_another_method_asks_for_its_track(bpy: Any, tmp_path: Path) -> None:
    tensors, information = make_model(5, FRAMES)
    information |= {"version": 3, "method": "fourdgs"}
    path = write_model(tmp_path / "model.safetensors", {"gaussians": tensors["anchors.position"]}, information)
    with pytest.raises(RuntimeError, match=r"a model of 'fourdgs'.*export its track file with aa4d export --format tr"):
        bpy.ops.aa4d.import_model(filepath=str(path))

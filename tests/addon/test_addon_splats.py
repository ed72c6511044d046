"""Splats that Blender draws itself, from 5.3 on, and what stands in for them before."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, go_to, imported, played, render, set_input, splats_of, srgb
from model_files import make_model, make_single, write_model

LOOK, TIME = "AdaAnchor4D", "AdaAnchor4D Time"
SPLATS = "Native Splats"
SH_0 = 0.28209479177387814


@pytest.mark.parametrize("baked", [False, True])
def test_splats_are_the_gaussians_of_the_model(native: Any, extension: str, model_path: Path, baked: bool) -> None:
    assert native.ops.aa4d.import_model(filepath=str(model_path), bake=baked) == {"FINISHED"}
    obj = native.context.active_object
    assert obj.aa4d.carrier == "GAUSSIANS"
    set_input(extension, obj, LOOK, "Softness", 0.0)
    frames = (1, 3, 4) if baked else (1, 2.5, 4)
    seen = []
    for frame in frames:
        obj.modifiers[LOOK].show_viewport = True
        go_to(native, frame)
        splats, points = splats_of(native, obj), played(native, obj)
        np.testing.assert_allclose(splats["position"], points["position"], atol=1e-5)
        shown = points["aa_opacity"] >= 0.05
        assert 0 < shown.sum() < len(shown)
        np.testing.assert_allclose(splats["scale"][shown], points["aa_scale"][shown], rtol=1e-5)
        np.testing.assert_allclose(splats["rotation"], points["aa_rotation"], atol=1e-5)
        np.testing.assert_allclose(
            0.5 + SH_0 * splats["radiance:base"][:, :3], srgb(points["aa_color"][:, :3]), atol=2e-4
        )
        np.testing.assert_allclose(splats["radiance:base"][shown, 3], points["aa_opacity"][shown], atol=1e-5)
        assert not splats["radiance:base"][~shown, 3].any()
        assert not splats["scale"][~shown].any()
        seen.append(splats["position"])
    assert np.abs(seen[0] - seen[1]).max() > 0.1


def test_splats_of_vehicles_are_painted_and_hidden(native: Any, extension: str, tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.safetensors", *make_model(60, 5, groups=2))
    world = imported(native, path, carrier="GAUSSIANS")
    car = next(child for child in world.children if child.name.startswith("car 1") and child.type == "MESH")
    before = splats_of(native, car)["radiance:base"]
    set_input(extension, car, LOOK, "Paint Strength", 1.0)
    assert np.abs(splats_of(native, car)["radiance:base"] - before).max() > 0.1
    assert set(splats_of(native, car)["aa_id"]).isdisjoint(splats_of(native, world)["aa_id"])


def test_splats_show_the_colour_of_the_model(native: Any, tmp_path: Path) -> None:
    """One large opaque Gaussian in the middle of the picture, within 3/255, and its row in the pass of rows."""
    color = np.array([0.8, 0.35, 0.1])
    tensors, information = make_single(1)
    tensors["decoder_color.output.bias"][:] = np.tile(np.log(color / (1 - color)), 3)
    path = write_model(tmp_path / "model.safetensors", tensors, information)
    imported(native, path, carrier="GAUSSIANS", set_up_scene=True)
    pixels = render(native, tmp_path / "picture.png", samples=64)
    np.testing.assert_allclose(pixels[27, 48, :3], color, atol=3 / 255)


def test_softness_widens_by_the_filter_of_the_training(bpy: Any, model_path: Path) -> None:
    """The drawn scale is sqrt(s^2 + (softness * depth)^2); softness is sqrt(0.3) px through the capture's lens."""
    obj = imported(bpy, model_path, carrier="GAUSSIANS", look="Gaussians", set_up_scene=True)
    _, information = make_model(60, 5)
    soft = 0.3**0.5 / information["camera"]["K"][0][0]
    sizes = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance and instance.parent.original == obj:
            sizes.append(instance.matrix_world.to_scale()[:])
    drawn = attribute(obj.data, "aa_opacity") >= 0.05
    forward = np.array(information["frames"][0]["viewmat"])[2]
    depth = attribute(obj.data, "position")[drawn] @ forward[:3] + forward[3]
    expected = np.sqrt(attribute(obj.data, "aa_scale")[drawn] ** 2 + (soft * np.maximum(depth, 0))[:, None] ** 2)
    np.testing.assert_allclose(sizes, expected, rtol=2e-3)


def test_look_of_an_older_blender_is_welcomed(native: Any, extension: str, model_path: Path, tmp_path: Path) -> None:
    """A group without the look, as a Blender before 5.3 saves it: values stay, the look is offered, and it is said."""
    looks, node_groups = (importlib.import_module(f"{extension}.looks{name}") for name in ("", ".node_groups"))
    modifiers = importlib.import_module(f"{extension}.modifiers")
    obj = imported(native, model_path)
    set_input(extension, obj, LOOK, "Size", 2.0)
    group = obj.modifiers[LOOK].node_group.copy()
    group["aa_version"] = f"AdaAnchor4D Look {looks.VERSION}"
    obj.modifiers[LOOK].node_group = group
    native.ops.wm.save_as_mainfile(filepath=str(tmp_path / "older.blend"))
    native.ops.wm.open_mainfile(filepath=str(tmp_path / "older.blend"))
    obj = next(obj for obj in native.data.objects if obj.aa4d.filepath)
    look = obj.modifiers[LOOK]
    assert look.node_group == node_groups.look_group()
    assert (modifiers.get(look, "Size"), modifiers.get(look, "Look")) == (2.0, "Points")

"""A render that blends sRGB values, as training does."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import imported, read_ply, render, set_input
from track_files import FRAMES, make_still, write_track

LOOK = "AdaAnchor4D"
COLORS = np.array([[0.9, 0.2, 0.1], [0.1, 0.3, 0.9], [0.3, 0.8, 0.2]])
BACKGROUND = (0.2, 0.5, 0.7)


@pytest.fixture
def stack(tmp_path: Path) -> Path:
    """Three wide half-transparent Gaussians one behind the other, in front of a camera that looks along y.

    Their reach of three deviations leaves the camera out: inside it, Blender 5.3 may take what is behind first.
    """
    attributes = {
        "position": np.array([[0, 10, 0], [0, 12, 0], [0, 14, 0]]),
        "rotation": np.tile([1.0, 0, 0, 0], (3, 1)),
        "log_scale": np.log([[1.5, 0.05, 1.5]] * 3),
        "opacity": np.full((3, 1), 0.5),
        "color": COLORS,
    }
    camera = {"model": "PINHOLE", "width": 16, "height": 10, "K": [[80, 0, 8], [0, 80, 5], [0, 0, 1]]}
    viewmat = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    parts = make_still(attributes, camera, [viewmat] * FRAMES, list(BACKGROUND))
    return write_track(tmp_path / "track.safetensors", *parts)


def expected() -> np.ndarray:
    """Front to back in sRGB values."""
    left, color = 1.0, np.zeros(3)
    for value in COLORS:
        color, left = color + 0.5 * left * value, 0.5 * left
    return color + left * np.array(BACKGROUND)


@pytest.mark.parametrize("look", ["Gaussians", "Native Splats"])
def test_half_transparent_stack_is_blended_as_in_training(bpy: Any, stack: Path, tmp_path: Path, look: str) -> None:
    if look == "Native Splats" and not hasattr(bpy.types, "GeometryNodePointsSetType"):
        pytest.skip(
            f"needs Blender 5.3 or later, this is {bpy.app.version_string}; test_addon_other_blenders.py runs it"
        )
    imported(bpy, stack, look=look, set_up_scene=True)
    samples = 8 if look == "Gaussians" else 256
    linear = render(bpy, tmp_path / "linear.png", samples=samples)[4:6, 7:9, :3].mean(axis=(0, 1))
    assert bpy.ops.aa4d.trained_picture() == {"FINISHED"}
    trained = render(bpy, tmp_path / "trained.png", samples=samples)[4:6, 7:9, :3].mean(axis=(0, 1))
    np.testing.assert_allclose(trained, expected(), atol=0.012 if look == "Gaussians" else 0.025)
    assert np.abs(linear - expected()).max() > 0.06


def test_going_back_restores_what_was_there(bpy: Any, extension: str, stack: Path) -> None:
    imported(bpy, stack, set_up_scene=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.view_settings.exposure = "Filmic", 0.5
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 2.0
    scene.cycles.use_denoising, scene.render.dither_intensity = True, 0.7
    node = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    before = node.inputs["Color"].default_value[:]
    for _ in range(2):
        bpy.ops.aa4d.trained_picture()
    assert (scene.view_settings.view_transform, scene.view_settings.exposure) == ("Raw", 0)
    assert (scene.cycles.use_denoising, scene.render.dither_intensity) == (False, 0)
    np.testing.assert_allclose(node.inputs["Color"].default_value[:3], BACKGROUND, atol=1e-6)
    second = imported(bpy, stack)
    assert inputs_of(extension, second)["Trained Picture"]
    bpy.ops.aa4d.trained_picture(use=False)
    assert (scene.view_settings.view_transform, scene.view_settings.exposure) == ("Filmic", 0.5)
    assert (scene.cycles.use_denoising, scene.render.dither_intensity) == (True, pytest.approx(0.7))
    assert scene.cycles.transparent_max_bounces == 64
    assert (scene.cycles.pixel_filter_type, scene.cycles.filter_width) == ("GAUSSIAN", 2.0)
    np.testing.assert_allclose(node.inputs["Color"].default_value[:], before)
    assert not inputs_of(extension, second)["Trained Picture"]


def test_faint_gaussians_are_drawn_unless_a_person_says_otherwise(bpy: Any, extension: str, stack: Path) -> None:
    """The rasteriser draws what reaches 1/255."""
    usual, changed = imported(bpy, stack), imported(bpy, stack)
    set_input(extension, changed, LOOK, "Minimum Opacity", 0.3)
    for on, opacity in ((True, 1 / 255), (False, 0.05)):
        bpy.ops.aa4d.trained_picture(use=on)
        assert inputs_of(extension, usual)["Minimum Opacity"] == pytest.approx(opacity)
        assert inputs_of(extension, changed)["Minimum Opacity"] == pytest.approx(0.3)


def test_what_an_older_version_kept_is_restored(bpy: Any, stack: Path) -> None:
    """It kept fewer settings; the others stay as they are."""
    imported(bpy, stack, set_up_scene=True)
    scene = bpy.context.scene
    scene["aa_kept"] = {"view_transform": "Filmic", "look": "None"}
    scene.view_settings.view_transform, scene.render.dither_intensity = "Raw", 0.7
    assert bpy.ops.aa4d.trained_picture(use=False) == {"FINISHED"}
    assert (scene.view_settings.view_transform, scene.render.dither_intensity) == ("Filmic", pytest.approx(0.7))


def test_look_of_an_older_version_is_renewed_with_its_settings(bpy: Any, extension: str, stack: Path) -> None:
    obj = imported(bpy, stack, look="Gaussians", set_up_scene=True)
    set_input(extension, obj, LOOK, "Size", 2.0)
    current = obj.modifiers[LOOK].node_group
    older = current.copy()
    older["aa_version"] = current["aa_version"].replace("Look 9", "Look 8")
    obj.modifiers[LOOK].node_group = older
    bpy.ops.aa4d.trained_picture()
    assert obj.modifiers[LOOK].node_group == current
    settings = inputs_of(extension, obj)
    assert (settings["Size"], settings["Look"], settings["Trained Picture"]) == (2.0, "Gaussians", True)


def inputs_of(extension: str, obj: Any) -> dict[str, Any]:
    return importlib.import_module(f"{extension}.modifiers").values_of(obj.modifiers[LOOK])


def test_lit_compositing_stays_linear(bpy: Any, extension: str, stack: Path) -> None:
    """What is lit is not encoded, and setting up compositing turns the trained picture off."""
    obj = imported(bpy, stack, look="Discs", set_up_scene=True, trained_picture=True)
    assert inputs_of(extension, obj)["Trained Picture"]
    set_input(extension, obj, LOOK, "Lit", True)
    assert bpy.ops.aa4d.set_up_compositing(mode="SCENE") == {"FINISHED"}
    assert bpy.context.scene.view_settings.view_transform == "Standard"
    assert not inputs_of(extension, obj)["Trained Picture"]


def test_exports_hold_the_trained_colours(bpy: Any, stack: Path, tmp_path: Path) -> None:
    imported(bpy, stack, set_up_scene=True, trained_picture=True)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "splats.ply")) == {"FINISHED"}
    ply = read_ply(tmp_path / "splats.ply")
    color = 0.5 + 0.28209479177387814 * np.stack([ply[f"f_dc_{i}"] for i in range(3)], 1)
    np.testing.assert_allclose(color, COLORS, atol=2e-3)
    np.testing.assert_allclose(np.exp(ply["scale_1"]), 0.05, rtol=1e-3)  # the filter is the viewer's own

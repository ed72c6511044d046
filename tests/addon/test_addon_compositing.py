"""Renders of the packaged extension: shadows, hiding, passes, motion blur."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import go_to, imported, render, set_input
from model_files import make_model, write_model

TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"


def test_ground_is_found_under_what_stands_on_it(extension: str) -> None:
    compositing = importlib.import_module(f"{extension}.compositing")
    random = np.random.default_rng(2)
    xy = random.uniform(-50, 50, (4000, 2))
    z = 0.02 * xy[:, 0] - 0.01 * xy[:, 1] + 100 + random.normal(0, 0.05, 4000)
    z[:1200] += random.uniform(0.5, 25, 1200)
    ground = compositing.fit_ground(np.column_stack([xy, z]).astype(np.float32))
    np.testing.assert_allclose(ground.slope, [0.02, -0.01], atol=2e-3)
    assert abs(ground.z(np.zeros(2)) - 100) < 0.1


def wall_scene(bpy: Any, tmp_path: Path, **options: Any) -> Any:
    """One large opaque Gaussian that fills the middle of the picture, a red cube half behind it and half beside it."""
    tensors, information = make_model(1, 1, stage="coarse")
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_color.output.bias"][:] = np.tile([2.0, 2.0, -2.0], 3)
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    tensors["anchors.position"][:] = tensors["anchors.offset"][:] = 0
    tensors["anchors.log_scale"][:] = -1.0
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    path = write_model(tmp_path / "model.safetensors", tensors, information)
    obj = imported(bpy, path, set_up_scene=True, **options)
    camera = bpy.context.scene.camera
    bpy.ops.mesh.primitive_cube_add(size=6)
    cube = bpy.context.active_object
    bpy.context.view_layer.update()
    place = camera.matrix_world @ __import__("mathutils").Vector((6, 0, -60))
    cube.location = place
    material = bpy.data.materials.new("red")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    material.node_tree.nodes.clear()
    glow, output = (material.node_tree.nodes.new(n) for n in ("ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    glow.inputs[0].default_value = (1, 0, 0, 1)
    material.node_tree.links.new(glow.outputs[0], output.inputs[0])
    cube.data.materials.append(material)
    bpy.context.view_layer.objects.active = obj
    return obj


@pytest.mark.parametrize("look", ["Points", "Discs", "Gaussians"])
def test_what_is_behind_the_points_is_hidden(bpy: Any, tmp_path: Path, look: str) -> None:
    obj = wall_scene(bpy, tmp_path, carrier="GAUSSIANS", look=look)
    pixels = render(bpy, tmp_path / "with.png")
    obj.hide_render = True
    alone = render(bpy, tmp_path / "without.png")
    red = (alone[..., 0] > 0.9) & (alone[..., 1] < 0.1)
    still = (pixels[..., 0] > 0.9) & (pixels[..., 1] < 0.1)
    assert red.sum() > 40
    assert 0.1 < still.sum() / red.sum() < 0.9
    tolerance = 4 if look == "Gaussians" else 2  # the pixel's centre is not quite the Gaussian's
    np.testing.assert_allclose(pixels[27, 48, :3], 1 / (1 + np.exp([-2, -2, 2])), atol=tolerance / 255)


def test_over_the_footage_only_the_new_is_seen(bpy: Any, extension: str, tmp_path: Path) -> None:
    """Holdout: the points hide the cube and are not seen; depth, Cryptomatte and ids are there for the compositor."""
    obj = wall_scene(bpy, tmp_path, carrier="GAUSSIANS", look="Points")
    assert bpy.ops.aa4d.set_up_compositing(mode="PLATE") == {"FINISHED"}
    assert obj.is_holdout
    set_input(extension, obj, LOOK, "Crop", "Off")  # one point has no ground to stand on
    for name in [o.name for o in bpy.data.objects if o.name.endswith("Ground")]:
        bpy.data.objects.remove(bpy.data.objects[name])
    pixels = render(bpy, tmp_path / "plate.png")
    seen = pixels[..., 3] > 0.9
    assert pixels[27, 48, 3] == 0
    assert pixels[2, 2, 3] == 0
    assert seen.sum() > 10
    assert (pixels[seen][:, 0] > 0.9).all()
    layer = bpy.context.view_layer
    assert layer.use_pass_z
    assert layer.use_pass_cryptomatte_object
    assert [aov.name for aov in layer.aovs] == ["AA Anchor"]
    assert bpy.ops.aa4d.set_up_compositing(mode="SCENE") == {"FINISHED"}
    assert not obj.is_holdout
    assert len(layer.aovs) == 1


@pytest.mark.parametrize("mode", ["SCENE", "PLATE"])
def test_a_cg_object_casts_its_shadow_on_the_ground(bpy: Any, tmp_path: Path, mode: str) -> None:
    """A flat field of grey points, a cube over its middle, the sun above: darker, or less transparent, under it."""
    tensors, information = make_model(900, 1, stage="coarse")
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    tensors["anchors.position"][:] = np.column_stack([x.ravel(), y.ravel(), np.zeros(900)])
    tensors["anchors.offset"][:] = 0
    tensors["anchors.log_scale"][:] = np.log(0.1)
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", tensors, information), set_up_scene=True)
    assert bpy.ops.aa4d.set_up_compositing(mode=mode) == {"FINISHED"}
    sun = next(o for o in bpy.data.objects if o.type == "LIGHT")
    sun.rotation_euler = (0, 0, 0)
    bpy.ops.mesh.primitive_cube_add(size=4)
    cube = bpy.context.active_object
    cube.location = (30, -20, 12)
    cube.visible_camera = False
    pixels = render(bpy, tmp_path / "with.png", samples=16)
    cube.hide_render = True
    alone = render(bpy, tmp_path / "without.png", samples=16)
    channel = 0 if mode == "SCENE" else 3
    change = np.abs(pixels[..., channel] - alone[..., channel])
    rows, columns = np.nonzero(change > 0.2)
    assert len(rows) > 8
    # The middle of the field is the middle of the picture, and so is the shadow from straight above.
    assert abs(rows.mean() - 27) < 6
    assert abs(columns.mean() - 48) < 6
    assert change[:5].max() < 0.1
    if mode == "PLATE":
        assert np.median(alone[..., 3]) == 0
    assert obj.visible_shadow == (mode == "SCENE")


def test_passes_hold_depth_and_anchor(bpy: Any, tmp_path: Path) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    wall_scene(bpy, tmp_path, look="Points")
    assert bpy.ops.aa4d.set_up_compositing(mode="SCENE") == {"FINISHED"}
    scene = bpy.context.scene
    render(bpy, tmp_path / "picture.png")
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.filepath = str(tmp_path / "passes.exr")
    bpy.ops.render.render(write_still=True)
    path = str(tmp_path / "passes.exr")
    channels: dict[str, np.ndarray] = {}
    for part in range(oiio.ImageBuf(path).nsubimages):  # Blender 5.2 writes a part a pass
        image = oiio.ImageBuf(path, part, 0)
        name, pixels = image.spec().getattribute("name") or "", image.get_pixels(oiio.FLOAT)
        channels.update({f"{name} {c}": pixels[..., i] for i, c in enumerate(image.spec().channelnames)})
    assert any("CryptoObject00" in name for name in channels)
    anchor = next(values for name, values in channels.items() if "AA Anchor" in name)
    depth = next(values for name, values in channels.items() if "Depth" in name)
    assert anchor[27, 48] == 1  # aa_id 0, plus one
    assert anchor[1, 1] == 0
    assert 30 < depth[27, 48] < 60


def test_blender_without_cycles_says_so(bpy: Any, model_path: Path, capfd: Any) -> None:
    bpy.ops.preferences.addon_disable(module="cycles")
    try:
        capfd.readouterr()
        imported(bpy, model_path, set_up_scene=True)
        assert "Cycles is switched off" in "".join(capfd.readouterr())
        assert bpy.context.scene.camera is not None
        assert not bpy.ops.aa4d.set_up_compositing.poll()
    finally:
        bpy.ops.preferences.addon_enable(module="cycles")
    assert bpy.ops.aa4d.set_up_compositing.poll()


def moving_point(tmp_path: Path) -> Path:
    """One anchor that crosses the picture evenly, drawn large and white on black."""
    tensors, information = make_model(1, 5)
    for name, tensor in tensors.items():
        if name.startswith(("decoder_", "head_", "dlgd_", "acfa", "encoder")) or ".offset" in name:
            tensors[name] = np.zeros_like(tensor)
    tensors["anchors.position"][:] = [-1.5, 0, 0]
    tensors["anchors.log_scale"][:] = np.log(0.1)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_color.output.bias"][:] = 10
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    for name, tensor in tensors.items():  # every feature is the time axis of the planes, from 0 to 1
        if name.startswith("field.planes"):
            rising = np.linspace(0, 1, tensor.shape[1])[:, None] if name.endswith("t") else 0
            tensors[name] = np.broadcast_to(rising, tensor.shape).astype(np.float32)
    tensors["encoder.weight"][0, 0] = 6.0  # three of six planes rise: h = t / 2
    tensors["head_position.hidden.weight"][0, 0] = 1.0
    tensors["head_position.output.weight"][0, 0] = 1.0
    information["background"] = [0, 0, 0]
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    for frame in information["frames"]:
        frame["viewmat"] = information["frames"][0]["viewmat"]
    return write_model(tmp_path / "model.safetensors", tensors, information)


@pytest.mark.parametrize("look", ["Points", "Gaussians"])
@pytest.mark.parametrize("baked", [False, True])
def test_motion_blur_is_the_average_of_sub_frames(
    bpy: Any, extension: str, tmp_path: Path, baked: bool, look: str
) -> None:
    obj = imported(bpy, moving_point(tmp_path), look=look, carrier="GAUSSIANS", bake=baked, set_up_scene=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Raw"  # averages are of light, not of sRGB values
    go_to(bpy, 3)
    brute = []
    for sub in (np.arange(9) + 0.5) / 9 - 0.5:  # rendering goes to the whole frame: the clip is moved instead
        set_input(extension, obj, TIME, "Start Frame", float(1 - sub))
        brute.append(render(bpy, tmp_path / "sub.png", samples=16))
    set_input(extension, obj, TIME, "Start Frame", 1.0)
    brute = np.mean(brute, axis=0)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    blurred = render(bpy, tmp_path / "blurred.png", samples=64)
    scene.render.use_motion_blur = False
    sharp = render(bpy, tmp_path / "sharp.png", samples=16)
    assert np.abs(sharp - brute)[..., 0].max() > 0.3
    assert np.abs(blurred[..., :3] - brute[..., :3]).mean() < 0.25 * np.abs(sharp[..., :3] - brute[..., :3]).mean()
    weights = [picture[..., 0] / picture[..., 0].sum() for picture in (blurred, brute)]
    for axis in (0, 1):
        places = [(weight.sum(axis=1 - axis) * np.arange(weight.shape[axis])).sum() for weight in weights]
        assert abs(places[0] - places[1]) < 0.5

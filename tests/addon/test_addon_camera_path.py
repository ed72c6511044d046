"""The flight of Blender's camera as a camera path of aa4d."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import go_to, imported, set_input
from model_files import make_model

FRAMES = 5


@pytest.mark.parametrize("baked", [False, True])
def test_drone_camera_goes_out_as_it_came_in(bpy: Any, model_path: Path, tmp_path: Path, baked: bool) -> None:
    """Also where the scene was turned, moved and scaled with its camera."""
    from mathutils import Matrix

    obj = imported(bpy, model_path, set_up_scene=True, bake=baked)
    for place in (
        Matrix(),
        Matrix.Translation((10, 20, 3)) @ Matrix.Rotation(0.7, 4, "Z") @ Matrix.Diagonal((2, 2, 2, 1)),
    ):
        obj.matrix_world = place
        parent = bpy.data.objects.new("parent", None)
        bpy.context.collection.objects.link(parent)
        bpy.context.scene.camera.parent, parent.matrix_world = parent, place
        go_to(bpy, 2)
        path = tmp_path / "flight.json"
        assert bpy.ops.aa4d.export_camera_path(filepath=str(path)) == {"FINISHED"}
        assert bpy.context.scene.frame_current == 2
        document, (_, information) = json.loads(path.read_text()), make_model(60, FRAMES)
        assert (document["format"], document["version"]) == ("aa4d-camera-path", 1)
        assert document["fps"] == pytest.approx(29.97, rel=1e-5)
        assert (document["camera"]["width"], document["camera"]["height"]) == (320, 180)
        np.testing.assert_allclose(document["camera"]["K"], information["camera"]["K"], atol=2e-3)
        np.testing.assert_allclose([view["t"] for view in document["views"]], np.linspace(0, 1, FRAMES), atol=1e-6)
        for view, frame in zip(document["views"], information["frames"], strict=True):
            np.testing.assert_allclose(view["viewmat"], frame["viewmat"], atol=3e-4)


def test_aa4d_reads_the_path(bpy: Any, extension: str, model_path: Path, tmp_path: Path) -> None:
    reading = pytest.importorskip("aa4d.filming.camera_path")
    obj = imported(bpy, model_path, set_up_scene=True)
    set_input(extension, obj, "AdaAnchor4D Time", "Reverse", True)
    path = tmp_path / "flight.json"
    assert bpy.ops.aa4d.export_camera_path(filepath=str(path)) == {"FINISHED"}
    read = reading.read_camera_path(path, None)
    assert [view.t for view in read.views] == pytest.approx([1, 0.75, 0.5, 0.25, 0])
    assert read.camera.width == 320


def test_camera_that_is_no_path_is_refused(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path, set_up_scene=True)
    camera, path = bpy.context.scene.camera, str(tmp_path / "flight.json")
    camera.data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="no perspective camera"):
        bpy.ops.aa4d.export_camera_path(filepath=path)
    camera.data.type = "PERSP"
    camera.data.keyframe_insert("lens", frame=1)
    camera.data.lens *= 2
    camera.data.keyframe_insert("lens", frame=5)
    with pytest.raises(RuntimeError, match="a camera path has one lens"):
        bpy.ops.aa4d.export_camera_path(filepath=path)
    camera.data.animation_data_clear()
    obj.scale = (1, 2, 1)
    with pytest.raises(RuntimeError, match="stretched"):
        bpy.ops.aa4d.export_camera_path(filepath=path)
    assert not list(tmp_path.glob("*.json"))

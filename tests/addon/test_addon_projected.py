"""The look Gaussians in the trained picture: what Blender renders against what the rasteriser draws."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import go_to, imported, render, set_input
from model_files import look_at
from splatting_reference import covariances_of, splatted
from track_files import FRAMES, make_still, write_track

LOOK = "AdaAnchor4D"
COUNT, MIDDLE, BACKGROUND = 40, np.array([3.0, -2.0, 1.0]), [0.2, 0.5, 0.7]
SIZE, K = (64, 40), np.array([[55.0, 0, 36], [0, 55, 18], [0, 0, 1]])
LEAST_DB = 52.0  # pixels of 8 bits alone are 58.9 dB from their values


def gaussians() -> dict[str, np.ndarray]:
    """Long ones that pierce each other: the order in which a ray enters them is not that of their centers."""
    random = np.random.default_rng(11)
    quaternions = random.normal(size=(COUNT, 4))
    return {
        "position": MIDDLE + random.normal(size=(COUNT, 3)) * [1.5, 1.5, 0.8],
        "rotation": quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        "log_scale": np.log(random.uniform([1.0, 0.1, 0.01], [2.0, 0.4, 0.2], (COUNT, 3))),
        "opacity": random.uniform(0.02, 1.0, (COUNT, 1)),
        "color": random.uniform(0, 1, (COUNT, 3)),
    }


def viewmats() -> list[np.ndarray]:
    angles = np.linspace(0.2, 2.6, FRAMES)
    return [look_at(MIDDLE + 9 * np.array([np.cos(angle), np.sin(angle), 0.6]), MIDDLE) for angle in angles]


@pytest.fixture
def pierced(tmp_path: Path) -> Path:
    camera = {"model": "PINHOLE", "width": SIZE[0], "height": SIZE[1], "K": K.tolist()}
    return write_track(tmp_path / "track.safetensors", *make_still(gaussians(), camera, viewmats(), BACKGROUND))


def expected(frame: int, matrix: np.ndarray | None = None) -> np.ndarray:
    """The rasteriser's picture of that frame, the object moved by `matrix` [4, 4]."""
    values = gaussians()
    matrix = np.eye(4) if matrix is None else matrix
    covariances = matrix[:3, :3] @ covariances_of(values["rotation"], np.exp(values["log_scale"])) @ matrix[:3, :3].T
    means = values["position"] @ matrix[:3, :3].T + matrix[:3, 3]
    camera = {"viewmat": viewmats()[frame - 1], "K": K, "size": np.array(SIZE)}
    return splatted(camera, means, covariances, values["opacity"][:, 0], values["color"], np.array(BACKGROUND))


def decibels(picture: np.ndarray, other: np.ndarray) -> float:
    return -10 * float(np.log10(np.mean((picture - other) ** 2)))


def drawn(bpy: Any, obj: Any) -> list[tuple[int, np.ndarray]]:
    """Of each instance, how many vertices its mesh has and its matrix [4, 4]."""
    return [
        (len(instance.object.data.vertices), np.array(instance.matrix_world))
        for instance in bpy.context.evaluated_depsgraph_get().object_instances
        if instance.is_instance and instance.parent.original == obj
    ]


@pytest.mark.parametrize("baked", [False, True])
def test_moving_camera_sees_the_picture_of_the_rasteriser(bpy: Any, pierced: Path, tmp_path: Path, baked: bool) -> None:
    imported(bpy, pierced, look="Gaussians", set_up_scene=True, trained_picture=True, bake=baked)
    for frame in (1, FRAMES) if baked else (1, 2, FRAMES):
        go_to(bpy, frame)
        picture = render(bpy, tmp_path / "picture.png", samples=4)[::-1, :, :3]
        assert decibels(picture, expected(frame)) > LEAST_DB


def test_stretched_object_is_projected_as_it_stands(bpy: Any, pierced: Path, tmp_path: Path) -> None:
    from mathutils import Euler, Matrix

    obj = imported(bpy, pierced, look="Gaussians", set_up_scene=True, trained_picture=True)
    obj.matrix_world = Matrix.LocRotScale((0.5, 3, -1), Euler((0.3, -0.2, 0.7)), (1.4, 0.6, 1.0))
    picture = render(bpy, tmp_path / "picture.png", samples=4)[::-1, :, :3]
    assert decibels(picture, expected(1, np.array(obj.matrix_world))) > LEAST_DB


def test_ellipsoids_stay_where_light_comes_from_all_sides(bpy: Any, extension: str, pierced: Path) -> None:
    """Without a camera, lit, and without the trained picture; discs have no more than twelve corners."""
    obj = imported(bpy, pierced, look="Gaussians", set_up_scene=True, trained_picture=True)
    set_input(extension, obj, LOOK, "Minimum Opacity", 0.0)

    def corners() -> set[int]:
        bpy.context.view_layer.update()
        return {count for count, _ in drawn(bpy, obj)}

    camera = bpy.context.scene.camera
    assert corners() == {12}
    bpy.context.scene.camera = None
    assert corners() == {42}
    bpy.context.scene.camera = camera
    assert corners() == {12}
    set_input(extension, obj, LOOK, "Lit", True)
    assert corners() == {42}
    set_input(extension, obj, LOOK, "Lit", False)
    bpy.ops.aa4d.trained_picture(use=False)
    assert corners() == {42}


def test_what_lies_behind_the_camera_is_not_there(bpy: Any, pierced: Path) -> None:
    """A camera among the Gaussians: those before it alone are drawn, finite and across its view."""
    obj = imported(bpy, pierced, look="Gaussians", set_up_scene=True, trained_picture=True)
    camera = bpy.context.scene.camera
    camera.animation_data_clear()
    camera.location = MIDDLE.tolist()
    bpy.context.view_layer.update()
    world = np.array(camera.matrix_world)
    depths = (gaussians()["position"] - world[:3, 3]) @ -world[:3, 2]
    instances = drawn(bpy, obj)
    assert len(instances) == (depths > 0.01).sum() > 5
    for _, matrix in instances:
        assert np.isfinite(matrix).all()
        np.testing.assert_allclose(world[:3, 2] @ matrix[:3, :2], 0, atol=1e-4 * np.abs(matrix).max())


def test_reference_is_the_rasteriser() -> None:
    torch = pytest.importorskip("torch")
    from aa4d.raster import reference
    from aa4d.raster.types import Camera, Gaussians, Options

    values = {name: torch.from_numpy(value) for name, value in gaussians().items()}
    scene = Gaussians(
        values["position"], values["rotation"], values["log_scale"].exp(), values["opacity"][:, 0], values["color"]
    )
    camera = Camera(torch.from_numpy(viewmats()[1]), torch.from_numpy(K), *SIZE)
    drawn = reference.rasterize(scene, camera, torch.tensor(BACKGROUND, dtype=torch.float64), Options())
    np.testing.assert_allclose(expected(2), drawn.color.numpy(), atol=2e-4)  # theirs stops at a transmittance of 1e-4

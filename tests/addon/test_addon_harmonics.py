"""Harmonics: colours of native splats that follow every camera."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import go_to, imported, render, set_input, splats_of, srgb
from model_files import look_at, make_model, make_single, write_model

from addon import affine, harmonics, names
from addon.carriers import color_errors, evaluate
from addon.field import prepare
from addon.model import read_model

LOOK = "AdaAnchor4D"
MIDDLE = np.array([30.0, -20.0, 4.0])
RANDOM = np.random.default_rng(5)


def directions(*shape: int) -> np.ndarray:
    found = RANDOM.normal(size=(*shape, 3))
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_formulas_are_those_of_the_exports(degree: int) -> None:
    theirs = pytest.importorskip("aa4d.export.harmonics")
    from scipy.spatial.transform import Rotation

    sides, colors, weights = directions(7, 40), RANDOM.uniform(0, 1, (7, 40, 3)), RANDOM.uniform(0, 1, (7, 40))
    np.testing.assert_allclose(harmonics.basis(sides, degree), theirs.basis(sides, degree), atol=1e-14)
    ours = harmonics.fitted(sides, colors - 0.5, weights, degree)
    np.testing.assert_allclose(ours, theirs.fitted(sides, colors, weights, degree), atol=1e-9)
    np.testing.assert_allclose(np.clip(0.5 + harmonics.valued(ours, sides), 0, 1), theirs.shown(ours, sides), atol=1e-9)
    turn = Rotation.from_rotvec([0.3, -1, 2])
    np.testing.assert_allclose(harmonics.turned(ours, turn.as_matrix()), theirs.turned(ours, turn), atol=1e-9)


@pytest.mark.parametrize("groups", [0, 2])
def test_fit_and_error_are_those_of_the_export(groups: int, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from aa4d.export import clip as exported
    from aa4d.filming.camera_path import path_of_frames
    from aa4d.methods.model_file import load_model

    path = write_model(tmp_path / "model.safetensors", *make_model(60, 12, groups=groups))
    loaded = load_model(path)
    clip = exported.Clip(loaded, path_of_frames(loaded, "all"), None, degree=2)
    field, index = prepare(read_model(path)), 5
    t, eye = clip.path.views[index].t, clip.eye_at(index)
    wanted = (*names.SHAPE, *names.HARMONICS[:9])
    values = evaluate(field, names.GAUSSIANS, t, eye, wanted)
    ours = np.stack([values[term] for term in wanted[2:]], axis=1).astype(np.float64)
    ours[:, 0] += (srgb(values[names.COLOR][:, :3]) - 0.5) / harmonics.SH_CONSTANT
    theirs = clip.every_gaussian(index)
    drawn = theirs.opacities >= exported.FAINTEST
    np.testing.assert_allclose(ours[drawn], theirs.coefficients()[drawn], atol=2e-3)
    assert not any(values[term][~drawn].any() for term in wanted[2:])
    errors, expected = color_errors(field, t, eye, values), clip.color_errors(index)
    assert errors == pytest.approx((expected["fitted"], expected["frozen"]), rel=1e-3)
    assert errors is not None
    assert errors[0] < errors[1]


def test_harmonics_turn_with_what_turns_the_points() -> None:
    turn, _ = np.linalg.qr(RANDOM.standard_normal((3, 3)))
    matrix, terms = np.eye(4), names.HARMONICS[:16]
    matrix[:3, :3] = 2.5 * turn  # in half the cases a reflection too
    values = {names.POSITION: np.zeros((4, 3), np.float32)}
    values |= {term: RANDOM.normal(size=(4, 3)).astype(np.float32) for term in terms}
    sides = directions(4, 30)

    def seen(shown: dict[names.Attribute, np.ndarray], sides: np.ndarray) -> np.ndarray:
        return harmonics.valued(np.stack([shown[term] for term in terms], axis=1).astype(np.float64), sides)

    after = affine.moved(values, matrix)
    np.testing.assert_allclose(seen(after, sides @ turn.T), seen(values, sides), atol=1e-5)


def radiance_of(bpy: Any, obj: Any) -> dict[str, np.ndarray]:
    """Every attribute of the splats that says what colour they have."""
    return {name: values for name, values in splats_of(bpy, obj).items() if name.startswith("radiance:")}


@pytest.mark.parametrize("baked", [False, True])
def test_splats_hold_the_harmonics_of_each_frame(native: Any, extension: str, tmp_path: Path, baked: bool) -> None:
    path = write_model(tmp_path / "model.safetensors", *make_model(60, 12))
    obj = imported(native, path, carrier="GAUSSIANS", harmonics=2, bake=baked)
    field, seen = prepare(read_model(path)), []
    for frame in (1, 6, 12):
        go_to(native, frame)
        splats = radiance_of(native, obj)
        assert set(splats) == {"radiance:base", *(f"radiance:sh_{index}" for index in range(8))}
        t = field.model.time_of_rank(frame - 1)
        wanted = (*names.SHAPE, *names.HARMONICS[:9])
        values = evaluate(field, names.GAUSSIANS, t, field.model.camera_center_at(t), wanted)
        for index in range(8):
            expected = values[names.HARMONICS[index + 1]]
            np.testing.assert_allclose(splats[f"radiance:sh_{index}"], expected, atol=2e-4 * np.abs(expected).max())
        base = (srgb(values[names.COLOR][:, :3]) - 0.5) / harmonics.SH_CONSTANT + values[names.HARMONICS[0]]
        np.testing.assert_allclose(splats["radiance:base"][:, :3], base, atol=0.01 if baked else 1e-3)
        seen.append(splats["radiance:sh_0"])
    assert np.abs(seen[0] - seen[2]).max() > 0.01
    set_input(extension, obj, LOOK, "Colour By", "Opacity")
    assert not radiance_of(native, obj)["radiance:sh_0"].any()
    set_input(extension, obj, LOOK, "Harmonics", 0)
    assert set(radiance_of(native, obj)) == {"radiance:base"}


def test_errors_of_harmonics_are_stated(native: Any, extension: str, tmp_path: Path, capfd: Any) -> None:
    path = write_model(tmp_path / "model.safetensors", *make_model(60, 12))
    obj = imported(native, path, carrier="GAUSSIANS", harmonics=1)
    playback = importlib.import_module(f"{extension}.playback")
    first = playback.color_errors[obj.session_uid]
    assert 0 < first[0] < first[1]
    set_input(extension, obj, LOOK, "Harmonics", 3)
    second = playback.color_errors[obj.session_uid]
    assert second[1] == first[1]
    assert second[0] != first[0]
    assert native.ops.aa4d.bake(use_range=True, first=1, last=2) == {"FINISHED"}
    told = "".join(capfd.readouterr())
    assert "colours are off by " in told


def two_sided(folder: Path) -> Path:
    """One opaque Gaussian that is redder the further east it is seen from, filmed from all around."""
    tensors, information = make_single(24)
    tensors["decoder_color.hidden.weight"][:2, -3] = [1, -1]  # of the direction's x: relu(x), relu(-x)
    tensors["decoder_color.output.weight"].reshape(3, 3, -1)[:, 0, :2] = [-1.2, 1.2]
    tensors["decoder_color.output.bias"][:] = np.tile([0.0, 0.6, -0.8], 3)
    for number, frame in enumerate(information["frames"]):
        frame["viewmat"] = look_at(eye_at(number / 24), MIDDLE).tolist()
    return write_model(folder / "model.safetensors", tensors, information)


def eye_at(share: float) -> np.ndarray:
    """A place on a circle about the Gaussian, the first in the east."""
    angle = 2 * np.pi * share
    return MIDDLE + np.array([40 * np.cos(angle), 40 * np.sin(angle), 25])


def look_from(bpy: Any, eye: np.ndarray) -> None:
    from mathutils import Vector

    camera = bpy.context.scene.camera
    camera.animation_data_clear()
    camera.location = eye
    camera.rotation_mode = "XYZ"
    camera.rotation_euler = Vector(MIDDLE - eye).to_track_quat("-Z", "Y").to_euler()
    bpy.context.view_layer.update()


@pytest.mark.parametrize(("trained", "turned"), [(False, False), (True, False), (False, True)])
def test_colour_follows_a_camera_to_another_side(native: Any, tmp_path: Path, trained: bool, turned: bool) -> None:
    """Within 4/255 of the model's own colour from there, also where object and camera have been turned.

    The trained picture takes the slope of its encoding at one colour, and this one changes by half its range.
    """
    path = two_sided(tmp_path)
    obj = imported(native, path, carrier="GAUSSIANS", set_up_scene=True, trained_picture=trained, harmonics=3)
    field, reds = prepare(read_model(path)), []
    if turned:
        from mathutils import Matrix

        there = Matrix.Translation(MIDDLE)
        obj.matrix_world = there @ Matrix.Rotation(np.pi / 2, 4, "Z") @ there.inverted()
    for share in (0.02, 0.27, 0.52):
        look_from(native, eye_at(share + 0.25 * turned))
        pixels = render(native, tmp_path / "side.png", samples=64)
        expected = evaluate(field, names.GAUSSIANS, 0.0, eye_at(share), names.SHAPE)[names.COLOR][0, :3]
        np.testing.assert_allclose(pixels[27, 48, :3], srgb(expected), atol=0.08 if trained else 4 / 255)
        reds.append(pixels[27, 48, 0])
    assert reds[0] - reds[2] > 0.3


def test_harmonics_where_there_are_none_are_left_out_and_said(bpy: Any, model_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path, harmonics=2)  # of anchors, in any Blender
    assert "Harmonics are of Native Splats of a model" in "".join(capfd.readouterr())
    assert not any(a.name.startswith("aa_sh_") for a in obj.data.attributes)

"""Spherical harmonics that hold how colors change with the side they are seen from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData
from scipy.spatial.transform import Rotation

from aa4d.errors import InputError
from aa4d.export import export, harmonics
from aa4d.export.clip import Clip, mean_eye, sights
from aa4d.export.harmonics import SH_CONSTANT, basis, fitted, shown, turned
from tests.toy_run import silent


def on_the_sphere(count: int) -> np.ndarray:
    """[count, 3] unit vectors, evenly spread (Fibonacci)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def test_harmonics_are_orthonormal() -> None:
    values = basis(on_the_sphere(20000), 3)
    np.testing.assert_allclose(4 * np.pi * values.T @ values / 20000, np.eye(16), atol=1e-4)


def test_a_fit_finds_the_coefficients_that_made_the_colors() -> None:
    rng = np.random.default_rng(3)
    truth = rng.uniform(-0.1, 0.1, (5, 16, 3))
    directions = np.broadcast_to(on_the_sphere(200), (5, 200, 3))
    colors = shown(truth, directions)
    assert 0 < colors.min() < colors.max() < 1  # nothing was clipped
    weights = rng.uniform(0.1, 1.0, (5, 200))
    np.testing.assert_allclose(fitted(directions, colors, weights, 3), truth, atol=1e-3)
    # Of a lower degree it is the best there is: the residual has no part along the harmonics.
    low = fitted(directions, colors, np.ones((5, 200)), 1)
    left = np.einsum("nec,nek->nck", basis(directions, 1), shown(low, directions) - colors) / 200
    assert np.abs(left).max() < 1e-5


def test_one_direction_gives_a_constant_and_no_weight_gives_grey() -> None:
    directions = np.broadcast_to([0.0, 0.6, 0.8], (2, 7, 3))
    colors = np.broadcast_to([0.9, 0.2, 0.4], (2, 7, 3))
    weights = np.stack([np.ones(7), np.zeros(7)])
    coefficients = fitted(directions, colors, weights, 3)
    everywhere = shown(coefficients, np.broadcast_to(on_the_sphere(50), (2, 50, 3)))
    np.testing.assert_allclose(everywhere[0], np.broadcast_to([0.9, 0.2, 0.4], (50, 3)), atol=1e-3)
    np.testing.assert_allclose(everywhere[1], 0.5)


def test_turned_harmonics_are_the_function_turned() -> None:
    coefficients = np.random.default_rng(1).normal(size=(4, 16, 3)) * 0.05
    rotation = Rotation.from_euler("xyz", [0.4, -1.1, 2.0])
    directions = on_the_sphere(40)
    before = shown(coefficients, np.broadcast_to(directions, (4, 40, 3)))
    after = shown(turned(coefficients, rotation), np.broadcast_to(rotation.apply(directions), (4, 40, 3)))
    np.testing.assert_allclose(after, before, atol=1e-12)


@pytest.fixture(scope="module")
def colored(clip: Clip) -> Clip:
    return replace(clip, eye=mean_eye(clip.path), degree=3)


def test_the_fit_is_nearer_to_what_cameras_see_than_one_eyes_colors(colored: Clip) -> None:
    """On training cameras, which it is fitted over; the toy was trained for seconds, its colors hardly turn."""
    fit = colored.gaussians(1)
    frozen = replace(colored, degree=0).gaussians(1)
    assert fit.ids.tolist() == frozen.ids.tolist()
    assert np.array_equal(fit.opacities, frozen.opacities)
    seen = sights(colored.loaded, colored.path.views[1].t, "training", fit.ids)
    off = [seen.error(g.means, g.coefficients()) for g in (frozen, fit)]
    assert off[1] < 0.3 * off[0]
    errors = colored.color_errors(1)
    assert errors["fitted"] < errors["frozen"]


def test_a_higher_degree_fits_better(colored: Clip) -> None:
    ids, means = colored.gaussians(0).ids, colored.gaussians(0).means
    seen = sights(colored.loaded, colored.path.views[0].t, "training", ids)
    errors = [seen.error(means, seen.fit(means, degree)) for degree in range(4)]
    assert errors == sorted(errors, reverse=True)


def test_ply_holds_them_channel_by_channel(colored: Clip, tmp_path: Path) -> None:
    said = export(colored, "ply", tmp_path / "out", silent)
    assert said is not None
    assert "harmonics of degree 3" in said
    vertex = PlyData.read(str(tmp_path / "out/clip_000008.ply"))["vertex"].data
    coefficients = colored.gaussians(1).coefficients()
    assert vertex.dtype.names[6:10] == ("f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0")
    for channel in range(3):
        np.testing.assert_allclose(vertex[f"f_dc_{channel}"], coefficients[:, 0, channel], atol=1e-5)
        for index in (1, 7, 15):
            column = vertex[f"f_rest_{15 * channel + index - 1}"]
            np.testing.assert_allclose(column, coefficients[:, index, channel], atol=1e-5)
    with pytest.raises(InputError, match="holds an export with other settings"):
        export(replace(colored, degree=2), "ply", tmp_path / "out", silent)


def test_without_held_out_cameras_the_file_is_whole_and_its_error_unknown(colored: Clip, tmp_path: Path) -> None:
    frames = tuple(replace(frame, split="train") for frame in colored.loaded.frames)
    said = export(replace(colored, loaded=replace(colored.loaded, frames=frames)), "ply", tmp_path / "out", silent)
    assert said == "No camera was held out to tell how far colors as harmonics of degree 3 are off"
    assert len(list((tmp_path / "out").glob("*.ply"))) == len(colored)


@pytest.mark.parametrize("name", ["points", "track", "html", "4dgs"])
def test_formats_without_room_for_them_say_so(colored: Clip, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"--harmonics 3: .* has one color a Gaussian"):
        export(colored, name, tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("degree", [-1, 4])
def test_a_degree_that_no_file_holds_is_refused(colored: Clip, tmp_path: Path, degree: int) -> None:
    with pytest.raises(InputError, match=f"--harmonics {degree}: must be a degree from 0 to 3"):
        export(replace(colored, degree=degree), "ply", tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


def test_the_constant_is_that_of_the_first_harmonic() -> None:
    assert basis(np.array([[0.0, 0, 1]]), 0) == pytest.approx(SH_CONSTANT)
    assert harmonics.degrees(2).tolist() == [0, 1, 1, 1, 2, 2, 2, 2, 2]

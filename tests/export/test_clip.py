"""A clip: what is seen from where, along which axes, and how fast it moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from aa4d.export import export
from aa4d.export.clip import (
    FAINTEST,
    VIEWER,
    Clip,
    WorldGaussians,
    mean_eye,
    turned,
    world_gaussians,
)
from aa4d.filming.camera_path import path_of_frames, resampled, with_time
from aa4d.methods.model_file import LoadedModel
from tests.export.scenes import left_out, riding
from tests.toy_run import silent


def test_the_viewers_axes_have_the_sky_up() -> None:
    one = WorldGaussians(
        ids=np.array([0]),
        means=np.array([[1.0, 2.0, 3.0]]),
        quaternions=np.array([[1.0, 0, 0, 0]]),
        scales=np.array([[1.0, 2.0, 3.0]]),
        opacities=np.array([0.5]),
        colors=np.array([[0.5, 0.5, 0.5]]),
    )
    moved = turned(one, VIEWER)
    assert moved.means[0] == pytest.approx([1, -3, 2])  # east stays right, up is against y, north is ahead
    assert np.abs(moved.quaternions[0]) == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0, 0])


def test_whose_view_is_kept(clip: Clip) -> None:
    """Anchors decode by direction: each view's own camera, or one for all."""
    first, last = clip.path.views
    assert np.array_equal(clip.gaussians(0).colors, world_gaussians(clip.loaded, first.t, first.center()).colors)
    eye = mean_eye(clip.path)
    assert eye == pytest.approx((first.center() + last.center()) / 2)
    fixed = replace(clip, eye=eye)
    assert np.array_equal(fixed.gaussians(1).colors, world_gaussians(clip.loaded, last.t, eye).colors)
    far = world_gaussians(clip.loaded, first.t, np.array([300.0, 0, 5]))
    near = clip.gaussians(0)
    common = np.intersect1d(far.ids, near.ids, return_indices=True)[1:]
    assert np.abs(far.colors[common[0]] - near.colors[common[1]]).max() > 1e-3


def test_nothing_drawn_is_left_out_and_nothing_faint_kept(loaded: LoadedModel) -> None:
    g = world_gaussians(loaded, 0.5, np.array([0.0, 0, 20]))
    assert g.opacities.min() >= FAINTEST
    np.testing.assert_allclose(np.linalg.norm(g.quaternions, axis=1), 1, atol=1e-12)
    assert (g.quaternions[:, 0] >= 0).all()
    assert (g.ids < loaded.model.anchors.offset.shape[0] * loaded.model.anchors.offset.shape[1]).all()


def test_riders_are_exported_where_they_are_and_absent_groups_are_left_out(toy_run: Path, tmp_path: Path) -> None:
    loaded = riding(toy_run)
    clip = Clip(loaded, path_of_frames(loaded, "held-out"), np.array([0.0, 0, 20]))
    first, later = clip.gaussians(0), clip.gaussians(1)  # t = 0 and 8/9
    assert first.group is not None
    assert later.group is not None
    assert set(first.group) == {-1, 0, 1}
    assert set(later.group) == {-1, 0}
    _, rows, rows_later = np.intersect1d(first.ids, later.ids, return_indices=True)
    rides = first.group[rows] == 0
    moved = later.means[rows_later] - first.means[rows]
    np.testing.assert_allclose(moved[rides], [[12 * 8 / 9, 0, 0]] * rides.sum(), atol=1e-3)
    np.testing.assert_allclose(moved[~rides], 0, atol=1e-3)
    for name in ("points", "ply"):
        export(clip, name, tmp_path / name, silent)
        prefix = "clip_" if name == "ply" else ""
        vertex = PlyData.read(str(tmp_path / name / f"{prefix}000008.ply"))["vertex"].data
        np.testing.assert_allclose(np.stack([vertex[n] for n in "xyz"], 1), later.means, atol=1e-4)
        # The layout of splats is fixed; that of points is free.
        assert ("group" in (vertex.dtype.names or ())) == (name == "points")
    np.testing.assert_array_equal(PlyData.read(str(tmp_path / "points/000008.ply"))["vertex"]["group"], later.group)


def test_velocities_are_those_of_the_square(toy_run: Path) -> None:
    """12 m in nine tenths of a second; on a path of twice as many views at the same rate, half as fast."""
    loaded = riding(toy_run)
    for views, speed in ((10, 12 / 0.9), (19, 12 / 1.8)):
        path = resampled(path_of_frames(loaded, "all"), views)
        clip = Clip(loaded, replace(path, fps=10.0, at=np.arange(views) / 10), None)
        for index in (0, 4, views - 1):
            g = clip.gaussians(index)
            assert g.group is not None
            expected = np.where(g.group >= 0, speed, 0.0)
            velocity = clip.velocities(index, g.ids)
            np.testing.assert_allclose(velocity, np.stack([expected, 0 * expected, 0 * expected], 1), atol=0.02)
        turned_ = replace(clip, axes="viewer").velocities(4, clip.gaussians(4).ids)
        np.testing.assert_allclose(turned_, VIEWER.apply(clip.velocities(4, clip.gaussians(4).ids)), atol=1e-6)
    frozen = Clip(loaded, with_time(path_of_frames(loaded, "all"), 0.5), None)
    assert np.abs(frozen.velocities(3, frozen.gaussians(3).ids)).max() < 1e-6


def test_velocities_over_a_gap_are_those_of_its_seconds(toy_run: Path) -> None:
    loaded = left_out(riding(toy_run))
    clip = Clip(loaded, path_of_frames(loaded, "all"), None)
    step_m = 12 / 9
    # Half a step of one second before frame 4, half a gap of six after it.
    for index, speed in ((1, step_m), (4, step_m / 3.5), (9, step_m / 2.5)):
        g = clip.gaussians(index)
        assert g.group is not None
        np.testing.assert_allclose(clip.velocities(index, g.ids)[:, 0], np.where(g.group >= 0, speed, 0), atol=0.02)

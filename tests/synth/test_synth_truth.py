"""Truth in closed form: planes, cars and skies whose flow, occlusion, boxes and activity are known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from synth.camera import intrinsics, invert_rigid, project
from synth.effects.lens_distortion import Settings
from synth.effects.lens_distortion import lens as brown_lens
from synth.flight.orientation import orientation
from synth.lens import Lens, Pinhole
from synth.spec import Camera
from synth.truth.activity import (
    APPEARANCE_ONLY,
    INTERMITTENT,
    PERSISTENT,
    STATIC,
    footprints,
    grid_around,
    heterogeneity_in_space,
    heterogeneity_in_time,
    intervals,
    label_of,
    sample_times,
    within,
)
from synth.truth.boxes import corners, projected, visible
from synth.truth.flow import flow
from synth.truth.occlusion import HIDDEN, OUTSIDE, SEEN, UNKNOWN, occlusion
from synth.truth.view import View

Array = NDArray[np.float64]
SIZE = (64, 48)
LENS = Pinhole(intrinsics(Camera(width_px=64, height_px=48, hfov_deg=60)))


def viewmat(x: float = 0.0, y: float = 0.0, z: float = 40.0, yaw: float = 0.0, pitch: float = -np.pi / 2) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = orientation(yaw, pitch)
    pose[:3, 3] = x, y, z
    return invert_rigid(pose)


def view(camera: Array, poses: Array | None = None, present: tuple[bool, ...] | None = None) -> View:
    poses = np.empty((0, 4, 4)) if poses is None else poses
    here = np.ones(len(poses), bool) if present is None else np.array(present, dtype=bool)
    return View(LENS, SIZE, camera, np.arange(1, len(poses) + 1, dtype=np.uint32), poses, here)


def at(*positions: tuple[float, float]) -> Array:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :2, 3] = positions
    return poses


def plane(camera: Array, height: float = 0.0) -> NDArray[np.float32]:
    """Depth of a level plane [H, W]."""
    rays = view(camera).rays() @ camera[:3, :3]
    eye = invert_rigid(camera)[:3, 3]
    return ((height - eye[2]) / rays[..., 2]).astype(np.float32)


NOBODY = np.zeros(SIZE[::-1], np.uint32)


def test_flow_over_a_plane_from_straight_above() -> None:
    here, there = viewmat(), viewmat(x=1.0)
    moved, valid = flow(view(here), view(there), plane(here), NOBODY)
    assert valid.all()
    metres_per_pixel = 40.0 / LENS.K[0, 0]
    # Image up is east at yaw 0: flying east moves the ground down in the picture.
    np.testing.assert_allclose(moved[..., 0], 0, atol=1e-4)
    np.testing.assert_allclose(moved[..., 1], 1.0 / metres_per_pixel, rtol=1e-5)


def test_flow_of_a_hovering_drone_is_exactly_zero() -> None:
    camera = viewmat(pitch=-0.9)
    moved, valid = flow(view(camera), view(camera), plane(camera), NOBODY)
    assert valid.all()
    assert np.abs(moved).max() < 1e-5


def test_flow_survives_five_hundred_kilometres() -> None:
    """float64 throughout: only the depth is float32."""
    near = flow(view(viewmat()), view(viewmat(x=1.0)), plane(viewmat()), NOBODY)[0]
    far = flow(view(viewmat(x=5e5)), view(viewmat(x=5e5 + 1.0)), plane(viewmat()), NOBODY)[0]
    np.testing.assert_allclose(far, near, atol=1e-5)


def test_instances_carry_their_pixels() -> None:
    camera, ids = viewmat(), NOBODY.copy()
    ids[20:24, 30:38] = 2
    here, there = view(camera, at((9, 9), (0, 0))), view(camera, at((9, 9), (2.0, 0)))
    moved, _ = flow(here, there, plane(camera), ids)
    expected = -2.0 * LENS.K[0, 0] / 40.0  # to the east is up
    np.testing.assert_allclose(moved[ids == 2][:, 1], expected, rtol=1e-5)
    assert np.abs(moved[ids == 0]).max() < 1e-5
    back, _ = flow(there, here, plane(camera), ids)
    np.testing.assert_allclose(back[ids == 2], -moved[ids == 2], atol=1e-4)


def test_who_appears_or_leaves_has_no_flow() -> None:
    camera, ids = viewmat(), NOBODY.copy()
    ids[10:20, 10:20], ids[30:35, 30:35] = 1, 7  # 7 is nobody
    here, gone = view(camera, at((0, 0))), view(camera, at((500, 500)), (False,))
    for first, second in ((here, gone), (gone, here)):
        moved, valid = flow(first, second, plane(camera), ids)
        assert not valid[ids > 0].any()
        assert np.isnan(moved[ids > 0]).all()
        assert valid[ids == 0].all()
        label = occlusion(first, second, plane(camera), ids, plane(camera), NOBODY)
        assert (label[ids > 0] == UNKNOWN).all()


def test_sky_moves_with_the_rotation_alone() -> None:
    here, there = viewmat(pitch=0.1), viewmat(x=30.0, y=5.0, pitch=0.1, yaw=0.02)
    sky = np.full(SIZE[::-1], np.inf, np.float32)
    moved, valid = flow(view(here), view(there), sky, NOBODY)
    assert valid.all()
    middle = moved[24, 32]
    assert middle[0] == pytest.approx(0.02 * np.cos(0.1) * LENS.K[0, 0], rel=0.02)


def test_horizon_in_view_gives_no_nan_where_valid() -> None:
    here, there = viewmat(pitch=0.0), viewmat(x=3.0, pitch=0.0)
    depth = plane(here)
    depth[depth <= 0] = np.inf
    moved, valid = flow(view(here), view(there), depth, NOBODY)
    assert np.isfinite(moved[valid]).all()
    assert valid.mean() > 0.9


def test_behind_the_camera_is_not_valid() -> None:
    here, there = viewmat(pitch=0.0, z=2.0), viewmat(x=1000.0, pitch=0.0, z=2.0)
    depth = plane(here)
    depth[depth <= 0] = np.inf
    _, valid = flow(view(here), view(there), depth, NOBODY)
    assert not valid[np.isfinite(depth) & (depth < 900)].any()


@pytest.mark.parametrize("lens", [LENS, brown_lens(Settings(k1=-0.1), LENS.K, SIZE)], ids=["pinhole", "brown"])
@pytest.mark.parametrize("before_m", [3e-4, 0.05, 0.2, 2.0])
def test_what_comes_to_the_cameras_plane_has_no_flow(lens: Lens, before_m: float) -> None:
    """The camera flies over a level plane until a row of pixels lies `before_m` before its plane: no millions of pixels
    are valid, and what is valid is right to a pixel though depth is known to a millionth only."""
    here = viewmat(pitch=0.0, z=2.0)
    depth = plane(here)
    depth[depth <= 0] = np.inf
    x = float(depth[36, 0]) - before_m
    first, second = (replace(view(m), lens=lens) for m in (here, viewmat(x=x, pitch=0.0, z=2.0)))
    moved, valid = flow(first, second, depth, NOBODY)
    assert not valid[36].any() or before_m == 2.0
    assert np.isnan(moved[~valid]).all()
    again, _ = flow(first, second, depth * np.float32(1 + 1e-6), NOBODY)
    assert np.abs(again - moved)[valid].max() < 1.0
    assert np.abs(moved[valid]).max() < 12 * LENS.K[0, 0]
    label = occlusion(first, second, depth, NOBODY, depth, NOBODY)
    assert ((label == UNKNOWN) == ~valid).all()


def test_sky_that_turns_to_the_cameras_plane_has_no_flow() -> None:
    """A quarter turn brings the sky of the picture's middle to the plane: exact, but a million pixels away."""
    here, there = viewmat(pitch=0.3), viewmat(pitch=0.3, yaw=np.pi / 2 - 1e-7)
    sky = np.full(SIZE[::-1], np.inf, np.float32)
    moved, valid = flow(view(here), view(there), sky, NOBODY)
    assert not valid[24, 31:33].any()
    assert np.abs(moved[valid]).max() < 12 * LENS.K[0, 0]


def test_occlusion_by_a_car_that_drives_over() -> None:
    camera, first, second = viewmat(), NOBODY.copy(), NOBODY.copy()
    first[20:26, 10:20], second[20:26, 30:40] = 1, 1
    shift = 20 * 40.0 / LENS.K[0, 0]
    here, there = view(camera, at((0, 0))), view(camera, at((0, -shift)))  # right in the picture is south
    label = occlusion(here, there, plane(camera), first, plane(camera), second)
    assert (label[21:25, 11:19] == SEEN).all()  # the car itself is found again
    assert (label[21:25, 31:39] == HIDDEN).all()
    assert (label[:18] == SEEN).all()
    outside = occlusion(view(viewmat()), view(viewmat(x=5.0)), plane(viewmat()), NOBODY, plane(viewmat(x=5.0)), NOBODY)
    gone = round(5.0 * LENS.K[0, 0] / 40.0)
    assert (outside[-gone + 1 :] == OUTSIDE).all()
    assert (outside[: -gone - 1] == SEEN).all()


def test_boxes_project_like_their_corners() -> None:
    camera = viewmat(pitch=-1.0, x=-20.0)
    poses, size = at((0, 0), (3.0, 4.0), (-500, 0)), np.tile([4.5, 1.8, 1.5], (3, 1))
    world = corners(poses, size)
    np.testing.assert_allclose(world[0, :, 2], [0] * 4 + [1.5] * 4)
    np.testing.assert_allclose(world[1].mean(axis=0), [3.0, 4.0, 0.75])
    uv, box = projected(view(camera, poses), world)
    expected, _ = project(world[0], camera, LENS.K)
    np.testing.assert_allclose(uv[0], expected)
    np.testing.assert_allclose(box[0], [*expected.min(axis=0), *expected.max(axis=0)])
    assert np.isnan(box[2]).all()  # behind
    _, absent = projected(view(camera, poses, (False, True, True)), world)
    assert np.isnan(absent[0]).all()


def test_visible_pixels_of_cars_of_two_pixels() -> None:
    ids = NOBODY.copy()
    ids[5, 7:9], ids[47, 63] = 3, 9
    counts, box = visible(ids, np.array([1, 3, 9], np.uint32))
    assert counts.tolist() == [0, 2, 1]
    assert box.tolist() == [[-1] * 4, [7, 5, 9, 6], [63, 47, 64, 48]]


def test_forty_thousand_instances_keep_their_ids() -> None:
    ids = np.arange(1, 40_001, dtype=np.uint32)
    seen = ids.reshape(200, 200)
    counts, box = visible(seen, ids)
    assert (counts == 1).all()
    assert box[39_999].tolist() == [199, 199, 200, 200]
    many = View(LENS, (200, 200), np.eye(4), ids, np.tile(np.eye(4), (40_000, 1, 1)), np.ones(40_000, bool))
    np.testing.assert_array_equal(many.index_of(seen).ravel(), np.arange(40_000))
    assert many.index_of(np.array([0, 40_001, 2**32 - 1], dtype=np.uint32)).tolist() == [-1, -1, -1]


def test_nobody_and_nothing() -> None:
    counts, box = visible(NOBODY, np.empty(0, np.uint32))
    assert (len(counts), box.shape) == (0, (0, 4))
    assert sample_times(np.zeros(1)).tolist() == [0.0]
    assert heterogeneity_in_space(np.full((2, 2), 4, np.uint8)) == 0.0
    assert heterogeneity_in_time(np.zeros((3, 2, 2), bool)) == 0.0


def test_labels_from_activity() -> None:
    active = np.zeros((20, 5), dtype=bool)
    active[:, 1], active[5:9, 2], active[1:, 3] = True, True, True
    changes = np.array([False, True, True, False, True])
    assert label_of(active, changes).tolist() == [STATIC, PERSISTENT, INTERMITTENT, PERSISTENT, APPEARANCE_ONLY]
    there = np.zeros_like(active)
    there[5:9] = True  # in the scene for those times alone
    assert label_of(active, changes, there)[2] == PERSISTENT


def test_intervals_of_motion() -> None:
    times = np.arange(6) * 0.5
    assert intervals(times, np.array([0, 1, 1, 0, 0, 1], bool), 3.0) == [(0.5, 1.5), (2.5, 3.0)]
    assert intervals(times, np.array([1, 1, 1, 1, 1, 0], bool), 3.0) == [(0.0, 2.5)]
    assert intervals(times, np.zeros(6, bool), 3.0) == []
    assert intervals(np.zeros(1), np.ones(1, bool), 0.5) == [(0.0, 0.5)]


@pytest.mark.parametrize("fps", [0.7, 7.3, 10.0, 24.0, 29.97, 60.0])
def test_moving_and_its_intervals_agree_at_every_frame(fps: float) -> None:
    """A car that stands for one frame, one that starts between two frames, and one that never stops."""
    frames = np.arange(31) / fps
    times = sample_times(frames)
    assert np.isin(frames, times).all()
    assert np.diff(times).max() <= 0.1 + 1e-9
    assert np.diff(times).min() > 0
    subjects = (np.abs(times - frames[1]) > 1e-3, times > frames[3] + 0.4 / fps, np.ones(len(times), bool),
                times < frames[-1], times >= frames[-1])  # fmt: skip
    for active in subjects:
        runs = np.array(intervals(times, active, 31 / fps)).reshape(-1, 2)
        np.testing.assert_array_equal(within(runs, frames), active[np.isin(times, frames)])


def test_footprints_cover_what_stands_there() -> None:
    grid = grid_around(np.array([[-10.0, -10.0, 0], [10.0, 10.0, 0]]), 1.0)
    assert grid.origin_m == (-10.0, -10.0)
    poses, size = at((0.5, 0.5)), np.array([[4.0, 2.0, 1.5]])
    touched = footprints(grid, poses, size, np.array([True]))
    rows, columns = np.nonzero(touched)
    assert (columns.min() - 10, columns.max() - 10) == (-2, 2)  # x from -1.5 to 2.5
    assert (rows.min() - 10, rows.max() - 10) == (-1, 1)
    assert not footprints(grid, poses, size, np.array([False])).any()
    assert grid.cell_of(np.array([np.nan, 0.0, 0.0])) == -1


def test_heterogeneity_is_what_the_document_says() -> None:
    one, four = np.zeros((4, 4), np.uint8), np.repeat(np.arange(4, dtype=np.uint8), 4)
    assert heterogeneity_in_space(one) == 0.0
    assert heterogeneity_in_space(four) == pytest.approx(1.0)
    assert heterogeneity_in_space(np.array([0, 0, 0, 1], np.uint8)) == pytest.approx(0.5623 / np.log(4), abs=1e-4)
    active = np.zeros((10, 3), bool)
    active[:, 0] = True
    assert heterogeneity_in_time(active) == 0.0  # one cell, always
    active[:5, 1] = True
    assert heterogeneity_in_time(active) == pytest.approx(0.5)  # and one for half the time

"""A browser's camera and ours are the same: axes, field of view, pixels."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aa4d.capture.schema import Frame, PinholeCamera
from aa4d.filming.camera_path import looking_at
from aa4d.viewer.cameras import (
    Eye,
    fov_that_shows,
    inside,
    pinhole,
    pixel_of,
    point_at,
    pose_at,
    to_orbit,
    viewmat_of,
    wxyz_of,
)

EYE_M, TARGET_M = np.array([12.0, -7.0, 30.0]), np.array([2.0, 3.0, 1.0])


def test_a_viser_camera_is_our_view_matrix() -> None:
    """viser: P_world = [R | t] p_camera, with R of `wxyz` and t of `position`, x right, y down, z forward."""
    viser = pytest.importorskip("viser")
    wxyz, position = np.array([0.8, -0.1, 0.5, 0.3]) / np.linalg.norm([0.8, -0.1, 0.5, 0.3]), np.array([1.0, 2.0, 3.0])
    pose = viser.transforms.SE3.from_rotation_and_translation(viser.transforms.SO3(wxyz), position)
    np.testing.assert_allclose(viewmat_of(wxyz, position), pose.inverse().as_matrix(), atol=1e-12)
    assert abs(wxyz_of(viewmat_of(wxyz, position)) @ wxyz) == pytest.approx(1)


def test_what_a_camera_looks_at_is_in_the_middle() -> None:
    viewmat = looking_at(EYE_M, TARGET_M)
    assert pixel_of(TARGET_M, viewmat, pinhole(1.0, 640, 360)) == pytest.approx((320, 180))
    np.testing.assert_allclose(Eye(viewmat, 1.0).center(), EYE_M)
    np.testing.assert_allclose(Eye(viewmat, 1.0).ahead(), (TARGET_M - EYE_M) / np.linalg.norm(TARGET_M - EYE_M))


def test_the_field_of_view_goes_from_the_upper_to_the_lower_edge() -> None:
    camera = pinhole(np.pi / 2, 640, 360)
    assert pixel_of(np.array([0.0, 1.0, 1.0]), np.eye(4), camera) == pytest.approx((320, 360))


def test_a_cell_of_another_shape_sees_all_that_the_window_sees() -> None:
    window, cell = pinhole(1.0, 640, 360), inside(1.0, 640 / 360, 320, 360)
    for corner in ((0, 0), (640, 0), (640, 360)):
        seen = pixel_of(point_at(corner, 1.0, np.eye(4), window), np.eye(4), cell)
        assert seen is not None
        assert -1e-9 <= seen[0] <= 320 + 1e-9
        assert -1e-9 <= seen[1] <= 360 + 1e-9


@pytest.mark.parametrize("aspect", [0.5, 16 / 9, 4.0])
def test_a_window_shows_the_whole_frame_and_no_more_than_it_must(aspect: float) -> None:
    camera = PinholeCamera(320, 180, np.array([[250.0, 0, 150], [0, 260, 100], [0, 0, 1]]))
    window = pinhole(fov_that_shows(camera, aspect), round(1000 * aspect), 1000)
    corners = [point_at(c, 1.0, np.eye(4), camera) for c in ((0, 0), (320, 0), (0, 180), (320, 180))]
    seen = np.array([pixel_of(corner, np.eye(4), window) for corner in corners])
    margin = np.concatenate([seen, [window.width, window.height] - seen])
    assert margin.min() == pytest.approx(0, abs=0.5)


def test_a_point_and_its_pixel_are_one_another_s_inverse() -> None:
    viewmat, camera = looking_at(EYE_M, TARGET_M), pinhole(0.9, 640, 360)
    point = point_at((100.0, 50.0), 25.0, viewmat, camera)
    assert (viewmat @ [*point, 1])[2] == pytest.approx(25)
    assert pixel_of(point, viewmat, camera) == pytest.approx((100, 50))
    assert pixel_of(2 * EYE_M - TARGET_M, viewmat, camera) is None


def test_between_frames_a_pose_turns_and_moves_evenly() -> None:
    frames = tuple(
        Frame(
            str(i),
            "",
            None,
            t,
            t,
            "train",
            viewmat_of(np.roll(Rotation.from_rotvec([0, 0, a]).as_quat(), 1), [a, 0, 0]),
        )
        for i, (t, a) in enumerate(((0.0, 0.0), (0.5, 0.2), (1.0, 0.6)))
    )
    between = pose_at(frames, 0.75)
    assert Rotation.from_matrix(between[:3, :3].T).as_rotvec() == pytest.approx([0, 0, 0.4])
    np.testing.assert_allclose(Eye(between, 1.0).center(), [0.4, 0, 0], atol=1e-12)
    for at in frames:
        np.testing.assert_allclose(pose_at(frames, at.t), at.viewmat, atol=1e-12)
    np.testing.assert_array_equal(pose_at(frames[:1], 0.4), frames[0].viewmat)


def test_a_browser_that_looks_straight_down_keeps_the_picture_s_upper_edge_up() -> None:
    """A browser's camera is made of where it stands, a point ahead and the world's up."""
    center = np.array([3.0, 4.0, 50.0])
    for image_up in ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-0.6, 0.8, 0.0]):
        down = np.array([0.0, 0.0, -1.0])
        viewmat = np.eye(4)
        viewmat[:3, :3] = np.cross(down, image_up), -np.array(image_up), down
        viewmat[:3, :3] *= np.sign(np.linalg.det(viewmat[:3, :3]))
        viewmat[:3, 3] = -viewmat[:3, :3] @ center
        browser = looking_at(center, to_orbit(Eye(viewmat, 1.0), np.array([3.0, 4.0, 0.0])))
        assert np.abs(browser[:3, :3] - viewmat[:3, :3]).max() < 3e-3
    oblique = Eye(looking_at(EYE_M, TARGET_M), 1.0)
    np.testing.assert_array_equal(to_orbit(oblique, TARGET_M), TARGET_M)


def test_an_eye_is_seen_from_where_it_is_whatever_its_roll() -> None:
    viewmat = looking_at(EYE_M, TARGET_M)
    rolled = viewmat.copy()
    rolled[:3] = Rotation.from_rotvec([0, 0, 0.3]).as_matrix() @ viewmat[:3]
    assert Eye(rolled, 1.0).is_seen_from(Eye(viewmat, 1.0), 1e-3)
    assert not Eye(looking_at(EYE_M + np.array([0, 0, 1]), TARGET_M), 1.0).is_seen_from(Eye(viewmat, 1.0), 1e-3)
    assert not Eye(looking_at(EYE_M, TARGET_M + np.array([1, 0, 0])), 1.0).is_seen_from(Eye(viewmat, 1.0), 1e-3)

"""A frame's picture as a turned camera sees it, in closed form."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aa4d.capture.reader import read_capture, read_image
from aa4d.capture.schema import Frame, PinholeCamera
from aa4d.viewer.cameras import pinhole
from aa4d.viewer.footage import Footage, turned

TAKEN_BY = PinholeCamera(64, 48, np.array([[60.0, 0, 31], [0, 62, 25], [0, 0, 1]]))


def directions(camera: PinholeCamera) -> NDArray[np.float64]:
    """[H, W, 3] unit, of each pixel's centre."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def far_world(rays: NDArray[np.float64]) -> NDArray[np.uint8]:
    """A smooth picture of all around, by direction in the world."""
    return np.asarray((127 + 100 * np.sin(3 * rays)).round(), np.uint8)


def frame_of(viewmat: NDArray[np.float64]) -> Frame:
    return Frame("0", "", None, 0.0, 0.0, "train", viewmat)


def test_of_the_same_camera_it_is_the_same_picture() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    photo = turned(picture, frame_of(np.eye(4)), TAKEN_BY, np.eye(4), TAKEN_BY)
    np.testing.assert_array_equal(photo.pixels, picture)
    assert photo.is_there.all()


def test_of_a_turned_camera_it_is_what_that_one_would_have_taken() -> None:
    frame, view = np.eye(4), np.eye(4)
    frame[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    view[:3, :3] = Rotation.from_rotvec([0.05, 0.1, -0.2]).as_matrix() @ frame[:3, :3]
    camera = pinhole(0.9, 80, 60)
    photo = turned(far_world(directions(TAKEN_BY) @ frame[:3, :3]), frame_of(frame), TAKEN_BY, view, camera)
    expected = far_world(directions(camera) @ view[:3, :3])
    assert 0.3 < photo.is_there.mean() < 1
    difference = np.abs(photo.pixels.astype(int) - expected)[photo.is_there]
    assert np.percentile(difference, 99) <= 2
    assert not photo.pixels[~photo.is_there].any()


def test_behind_a_camera_there_is_no_picture() -> None:
    view = np.eye(4)
    view[:3, :3] = Rotation.from_rotvec([0, np.pi, 0]).as_matrix()
    picture = np.full((48, 64, 3), 255, np.uint8)
    assert not turned(picture, frame_of(np.eye(4)), TAKEN_BY, view, TAKEN_BY).is_there.any()


def test_it_shows_the_nearest_frame_and_only_from_where_that_was_taken(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    footage, frame = Footage(capture, capture.frames, 0.01), capture.frames[3]
    photo = footage.seen(frame.viewmat, frame.t + 0.03, capture.camera)
    assert photo is not None
    assert photo.t == frame.t
    np.testing.assert_array_equal(photo.pixels, read_image(capture, frame))
    assert footage.seen(frame.viewmat, capture.frames[5].t, capture.camera) is None


def test_what_is_compared_has_the_capture_s_pixels(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    footage, c = Footage(capture, capture.frames, 0.01), capture.camera
    scale = np.array([[5.0], [5], [1]])
    large = PinholeCamera(5 * c.width, 5 * c.height, c.K * scale)
    as_sharp = footage.as_sharp(large)
    assert (as_sharp.width, as_sharp.height) == (c.width, c.height)
    np.testing.assert_allclose(as_sharp.K, c.K)

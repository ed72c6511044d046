"""The model frame: independent of metres, sound for a hovering drone, exact in projection."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.frame import ModelFrame, frame_of
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError


def scaled(capture: Capture, scale: float) -> Capture:
    """The same scene in other units."""
    frames = []
    for frame in capture.frames:
        viewmat = frame.viewmat.copy()
        viewmat[:3, 3] *= scale
        frames.append(replace(frame, viewmat=viewmat))
    return replace(capture, points=capture.points * scale, frames=tuple(frames))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_model_coordinates_do_not_depend_on_metres(toy_capture: Path, scale: float) -> None:
    capture = read_capture(toy_capture)
    other = scaled(capture, scale)
    a = frame_of(capture).to_model(capture.points)
    b = frame_of(other).to_model(other.points)
    np.testing.assert_allclose(a, b, atol=1e-12)


def test_unit_is_the_median_depth(toy_capture: Path) -> None:
    assert frame_of(read_capture(toy_capture)).unit_m == pytest.approx(20.0)


def test_hovering_camera_gives_a_finite_frame(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    hovering = replace(capture, frames=tuple(replace(f, viewmat=capture.frames[0].viewmat) for f in capture.frames))
    assert frame_of(hovering).unit_m == pytest.approx(20.0)


def test_model_camera_sees_what_the_world_camera_sees(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    frame = ModelFrame(17.0, np.array([3.0, -2.0, 0.5]))
    viewmat, K = capture.frames[4].viewmat, capture.camera.K
    camera = frame.camera(viewmat, K, 48, 32)
    world = capture.points @ viewmat[:3, :3].T + viewmat[:3, 3]
    matrix = camera.viewmat.double().numpy()
    model = frame.to_model(capture.points) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(model * 17.0, world, atol=1e-4)
    np.testing.assert_allclose(
        ModelFrame.from_matrix(frame.matrix()).to_model(capture.points), frame.to_model(capture.points)
    )


def test_cameras_that_see_no_point_are_refused(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match="no training camera sees any point"):
        frame_of(replace(capture, points=capture.points + np.array([0, 0, 100.0])))


def test_points_in_the_lens_give_no_unit(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    viewmat = capture.frames[0].viewmat
    frames = tuple(replace(frame, viewmat=viewmat) for frame in capture.frames)
    before_the_lens = -viewmat[:3, :3].T @ viewmat[:3, 3] - [0, 0, 1e-9]  # the toy's cameras look down
    near = replace(capture, frames=frames, points=np.tile(before_the_lens, (5, 1)))
    with pytest.raises(InputError, match=r"its cameras see the points at 1e-09 m, expected 1e-06 to 1e\+06 m"):
        frame_of(near)

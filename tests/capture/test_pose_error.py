"""Pose errors: what a world of its own does not count, and what does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aa4d.capture.orientation import Similarity
from aa4d.capture.pose_error import in_other_world, inverse, pose_error
from tests.capture import aerial

TRUTH = np.array(aerial.arc(12))
WORLD = Similarity(0.07, Rotation.from_rotvec([0.4, -2.0, 1.0]).as_matrix(), np.array([5.0, -3, 100]))


def test_a_world_of_its_own_is_no_error() -> None:
    found = in_other_world(TRUTH, WORLD)
    error = pose_error(found, TRUTH, 40.0)
    assert error.trajectory_m < 1e-9
    assert error.rotation_deg < 1e-6
    assert error.to_truth.scale == pytest.approx(1 / 0.07)
    back = in_other_world(found, inverse(WORLD))
    assert np.allclose(back, TRUTH, atol=1e-9)


def test_turned_and_shifted_cameras_count_by_as_much() -> None:
    generator = np.random.default_rng(0)
    found = in_other_world(TRUTH, WORLD)
    for matrix in found:
        turn = Rotation.from_rotvec(np.radians(0.5) * generator.normal(size=3)).as_matrix()
        centre = -matrix[:3, :3].T @ matrix[:3, 3] + 0.07 * 0.2 * generator.normal(size=3)
        matrix[:3, :3] = turn @ matrix[:3, :3]
        matrix[:3, 3] = -matrix[:3, :3] @ centre
    error = pose_error(found, TRUTH, 40.0)
    assert error.rotation_deg == pytest.approx(0.5 * np.sqrt(3), rel=0.3)
    assert error.trajectory_m == pytest.approx(0.2 * np.sqrt(3), rel=0.4)


def test_a_straight_flight_has_no_free_roll() -> None:
    """Centres on a line say nothing of a roll about it; the cameras' directions do."""
    line = np.array([aerial.look(np.array([x, -8.0, 40.0]), np.array([x, 1.5, 0.0])) for x in np.linspace(-8, 8, 9)])
    error = pose_error(in_other_world(line, WORLD), line, 41.0)
    assert error.rotation_deg < 1e-6
    assert error.trajectory_m < 1e-9

"""The drone's poses and the camera's mathematics."""

import itertools
import math

import numpy as np
import pytest

from synth.camera import intrinsics, invert_rigid, pixel_centres, project, quaternion, same_hemisphere, unproject
from synth.flight import ArcFlight, orientation
from synth.spec import Camera, Flight


def arc(
    sweep_deg: float = 75.0, radius_m: float = 36.0, start_deg: float = -100.0, duration_s: float = 4.0
) -> ArcFlight:
    flight = Flight(kind="arc", radius_m=radius_m, altitude_m=30.0, start_deg=start_deg, sweep_deg=sweep_deg)
    return ArcFlight(flight, duration_s)


@pytest.mark.parametrize("radius_m", [0.0, 1e-9, 36.0])
def test_poses_are_rigid_and_look_at_the_centre(radius_m: float) -> None:
    flight = arc(radius_m=radius_m)
    for time_s in np.linspace(0, 4, 33):
        pose = flight.camera_to_world(float(time_s))
        rotation = pose[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        towards = -pose[:3, 3] / np.linalg.norm(pose[:3, 3])
        np.testing.assert_allclose(rotation[:, 2], towards, atol=1e-12)
        assert rotation[2, 0] == 0.0  # level horizon
        assert rotation[2, 1] <= 1e-12  # the image's y axis never points up


def test_arc_sweeps_and_keeps_its_altitude() -> None:
    flight = arc(sweep_deg=75.0, start_deg=-100.0)
    first, last = flight.camera_to_world(0.0)[:3, 3], flight.camera_to_world(4.0)[:3, 3]
    swept = math.degrees(math.atan2(last[1], last[0]) - math.atan2(first[1], first[0]))
    assert swept == pytest.approx(75.0)
    assert first[2] == last[2] == 30.0


def test_orientation_is_continuous_through_nadir() -> None:
    pitches = np.radians(np.linspace(-80, -100, 2001))
    rotations = np.array([orientation(0.7, p) for p in pitches])
    angles = [math.acos(min(1.0, (np.trace(a.T @ b) - 1) / 2)) for a, b in itertools.pairwise(rotations)]
    np.testing.assert_allclose(angles, math.radians(0.01), rtol=1e-3)


def test_quaternions_stay_in_one_hemisphere_beyond_a_full_turn() -> None:
    flight = arc(sweep_deg=800.0)
    poses = [flight.camera_to_world(float(t)) for t in np.linspace(0, 4, 801)]
    quaternions = same_hemisphere(np.array([quaternion(p[:3, :3]) for p in poses]))
    assert np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]).min() > 0.99
    # Halfway between two keys, the normalised mean is the pose in the middle: also across the sign's change.
    for k in range(0, 800, 7):
        middle = quaternions[k] + quaternions[k + 1]
        expected = quaternion(flight.camera_to_world(4 * (k + 0.5) / 800)[:3, :3])
        assert abs(middle @ expected) / np.linalg.norm(middle) == pytest.approx(1.0, abs=1e-9)


def test_quaternion_matches_its_rotation() -> None:
    rng = np.random.default_rng(1)
    for w, x, y, z in [*rng.normal(size=(50, 4)), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (1, 0, 0, 0)]:
        n = math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / n, x / n, y / n, z / n
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        assert abs(quaternion(rotation) @ [w, x, y, z]) == pytest.approx(1.0)


def test_single_frame_has_a_pose() -> None:
    assert np.isfinite(arc(duration_s=0.0).viewmat(0.0)).all()


def test_project_inverts_unproject() -> None:
    K = intrinsics(Camera(width_px=96, height_px=54, hfov_deg=60))
    viewmat = arc().viewmat(1.3)
    uv = pixel_centres(96, 54)
    depth = np.random.default_rng(0).uniform(5, 90, size=uv.shape[:2])
    back, z = project(unproject(uv, depth, viewmat, K), viewmat, K)
    np.testing.assert_allclose(back, uv, atol=1e-9)
    np.testing.assert_allclose(z, depth, rtol=1e-12)


def test_field_of_view_and_principal_point() -> None:
    K = intrinsics(Camera(width_px=320, height_px=180, hfov_deg=60))
    assert math.degrees(2 * math.atan(160 / K[0, 0])) == pytest.approx(60)
    assert (K[0, 2], K[1, 2]) == (160, 90)
    assert K[0, 0] == K[1, 1]


def test_invert_rigid() -> None:
    pose = arc().camera_to_world(2.0)
    np.testing.assert_allclose(invert_rigid(pose) @ pose, np.eye(4), atol=1e-13)

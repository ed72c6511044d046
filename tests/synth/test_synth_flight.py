"""The drone's poses and the camera's mathematics."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from synth.camera import intrinsics, invert_rigid, pixel_centres, project, quaternion, same_hemisphere, unproject
from synth.flight import FLIGHTS, Trajectory, orientation
from synth.flight.arc import Arc
from synth.flight.hover import Hover
from synth.flight.line import Line
from synth.flight.orbit import Orbit
from synth.flight.spiral import Spiral
from synth.flight.waypoints import Waypoints
from synth.spec import Camera

Array = NDArray[np.float64]


def arc(
    sweep_deg: float = 75.0, radius_m: float = 36.0, start_deg: float = -100.0, duration_s: float = 4.0
) -> Trajectory:
    flight = Arc(radius_m=radius_m, altitude_m=30.0, start_deg=start_deg, sweep_deg=sweep_deg)
    return Trajectory(flight, duration_s)


def rotation_deg(a: Array, b: Array) -> float:
    """Angle between two poses [4, 4]: from the chord, which stays exact for small angles."""
    return math.degrees(2 * math.asin(min(1.0, float(np.linalg.norm(a[:3, :3] - b[:3, :3])) / math.sqrt(8))))


EXAMPLES = {
    "arc": Arc(radius_m=36.0, altitude_m=30.0, start_deg=300.0, sweep_deg=150.0),
    "orbit": Orbit(radius_m=36.0, altitude_m=30.0, turns=2.5),
    "line": Line(from_m=(-40.0, 0.0, 60.0), to_m=(40.0, 0.0, 60.0), target_m=(0.0, 0.0, 0.0)),
    "hover": Hover(position_m=(3.0, -4.0, 80.0), yaw_deg=350.0, pitch_deg=-90.0, sweep_deg=40.0),
    "spiral": Spiral(radius_m=(60.0, 0.0), altitude_m=(30.0, 110.0), start_deg=0.0, sweep_deg=500.0),
    "waypoints": Waypoints(
        points_m=((-60.0, -20.0, 40.0), (-20.0, 10.0, 55.0), (25.0, -5.0, 60.0), (60.0, 30.0, 35.0)),
        target_m=(0.0, 0.0, 0.0),
        yaw_deg=90.0,
    ),
}


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


def test_every_flight_has_an_example() -> None:
    assert EXAMPLES.keys() == FLIGHTS.keys()
    assert all(example.kind == name for name, example in EXAMPLES.items())
    assert all(example.problem() is None for example in EXAMPLES.values())


@pytest.mark.parametrize("kind", FLIGHTS)
def test_flights_are_rigid_and_continuous_at_any_real_time(kind: str) -> None:
    """Halving the step halves the change of pose: no jump anywhere, at nadir, beyond 360 degrees, where yaw wraps."""
    trajectory = Trajectory(EXAMPLES[kind], 8.0)
    largest = []
    for count in (801, 1601):
        poses = [trajectory.camera_to_world(float(t)) for t in np.linspace(-0.5, 8.5, count)]
        rotations = np.array([p[:3, :3] for p in poses])
        np.testing.assert_allclose(
            rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (count, 1, 1)), atol=1e-12
        )
        np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-12)
        turned = max(rotation_deg(a, b) for a, b in itertools.pairwise(poses))
        moved = max(float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in itertools.pairwise(poses))
        largest.append((turned, moved))
    assert largest[1][0] <= 0.55 * largest[0][0] + 1e-9
    assert largest[1][1] <= 0.55 * largest[0][1] + 1e-12


def test_line_passes_over_its_target_without_turning_over() -> None:
    trajectory = Trajectory(EXAMPLES["line"], 8.0)
    for offset in (0.0, 1e-9, 1e-3):
        flight = Line(from_m=(-40.0, offset, 60.0), to_m=(40.0, offset, 60.0), target_m=(0.0, 0.0, 0.0))
        pose = Trajectory(flight, 8.0).camera_to_world(4.0)
        np.testing.assert_allclose(pose[:3, 1], [-1, 0, 0], atol=1e-4)  # east, the way it flies, is up in the picture
        np.testing.assert_allclose(pose[:3, 2], [0, 0, -1], atol=1e-4)
    before, after = trajectory.camera_to_world(4.0 - 1e-6), trajectory.camera_to_world(4.0 + 1e-6)
    assert rotation_deg(before, after) < 1e-3


def test_flying_past_a_target_keeps_the_horizon_level() -> None:
    places = [(-60.0, -30.0, 25.0), (0.0, -30.0, 25.0), (60.0, -30.0, 25.0)]
    past = [Line(from_m=places[0], to_m=places[2], target_m=(0.0, 0.0, 0.0)),
            Waypoints(points_m=tuple(places), target_m=(0.0, 0.0, 0.0))]  # fmt: skip
    for flight in past:
        for time_s in (0.0, 3.3, 8.0):
            pose = Trajectory(flight, 8.0).camera_to_world(time_s)
            assert abs(pose[2, 0]) < 1e-12  # the picture's right side is horizontal
            assert pose[2, 1] < 0  # and its lower edge below
            towards = -pose[:3, 3] / np.linalg.norm(pose[:3, 3])
            np.testing.assert_allclose(pose[:3, 2], towards, atol=1e-12)


def test_orbit_comes_back_after_a_whole_turn() -> None:
    trajectory = Trajectory(Orbit(radius_m=36.0, altitude_m=30.0, turns=3.0), 9.0)
    for time_s in (0.0, 0.123, 2.9):
        np.testing.assert_allclose(
            trajectory.camera_to_world(time_s), trajectory.camera_to_world(time_s + 3.0), atol=1e-11
        )


def test_yaw_wraps_without_a_jump() -> None:
    trajectory = Trajectory(Hover(position_m=(0.0, 0.0, 50.0), yaw_deg=359.0, pitch_deg=-45.0, sweep_deg=2.0), 1.0)
    poses = [trajectory.camera_to_world(float(t)) for t in np.linspace(0, 1, 101)]
    angles = [rotation_deg(a, b) for a, b in itertools.pairwise(poses)]
    np.testing.assert_allclose(angles, 0.02, rtol=1e-6)


def test_hover_has_no_baseline() -> None:
    trajectory = Trajectory(Hover(position_m=(1.0, 2.0, 90.0), yaw_deg=30.0, pitch_deg=-90.0), 4.0)
    np.testing.assert_array_equal(trajectory.viewmat(0.0), trajectory.viewmat(3.7))


def test_waypoints_pass_through_their_places_with_continuous_acceleration() -> None:
    flight = EXAMPLES["waypoints"]
    points = np.array(flight.points_m)
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    shares = np.concatenate([[0.0], np.cumsum(gaps)]) / gaps.sum()
    for share, point in zip(shares, points, strict=True):
        np.testing.assert_allclose(flight.camera_to_world(float(share))[:3, 3], point, atol=1e-9)
    h = 1e-4
    at = [flight.camera_to_world(float(u))[:3, 3] for u in (shares[1] + np.arange(-3, 4) * h)]
    bends = np.diff(at, 2, axis=0) / h**2
    assert np.abs(np.diff(bends, axis=0)).max() < 0.01 * np.abs(bends).max()


def test_horizon_in_view_stays_finite() -> None:
    pose = Trajectory(Hover(position_m=(0.0, 0.0, 40.0), yaw_deg=0.0, pitch_deg=0.0), 1.0)
    K = intrinsics(Camera(width_px=96, height_px=54, hfov_deg=60))
    uv, depth = project(np.array([[1e4, 0.0, 40.0]]), pose.viewmat(0.0), K)
    np.testing.assert_allclose(uv, [[48.0, 27.0]], atol=1e-9)
    assert depth[0] == pytest.approx(1e4)


@pytest.mark.parametrize(
    ("flight", "words"),
    [
        (
            Arc(radius_m=10.0, altitude_m=5.0, centre_m=(0.0, 0.0, 6.0), start_deg=0.0, sweep_deg=1.0),
            "above the center",
        ),
        (Line(from_m=(0.0, 0.0, 0.0), to_m=(1.0, 0.0, 5.0)), "above the ground"),
        (Waypoints(points_m=((0.0, 0.0, 9.0),)), "two places"),
        (Waypoints(points_m=((0.0, 0.0, 9.0), (0.0, 0.1, 9.0))), "a meter apart"),
    ],
)
def test_impossible_flights_say_why(flight: object, words: str) -> None:
    assert words in str(flight.problem())  # type: ignore[attr-defined]

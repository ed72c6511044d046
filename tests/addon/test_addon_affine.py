"""Transforms of Gaussians against their covariance in float64."""

import numpy as np
import pytest

from addon import affine, names

RANDOM = np.random.default_rng(3)


def gaussians(count: int = 50) -> dict[names.Attribute, np.ndarray]:
    quaternions = RANDOM.standard_normal((count, 4))
    return {
        names.POSITION: RANDOM.uniform(-50, 50, (count, 3)).astype(np.float32),
        names.SCALE: RANDOM.uniform(0.01, 2, (count, 3)).astype(np.float32),
        names.ROTATION: (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float32),
        names.RADIUS: RANDOM.uniform(0.1, 1, count).astype(np.float32),
    }


def covariances(values: dict[names.Attribute, np.ndarray]) -> np.ndarray:
    axes = affine.rotations_of(values[names.ROTATION]) * values[names.SCALE].astype(np.float64)[:, None]
    return axes @ axes.transpose(0, 2, 1)


def a_map(kind: str) -> np.ndarray:
    matrix = np.eye(4)
    turn, _ = np.linalg.qr(RANDOM.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    matrix[:3, 3] = [10, -4, 2]
    matrix[:3, :3] = {
        "similarity": 2.5 * turn,
        "uneven": turn * [1, 2, 0.5],
        "mirror": turn * [1, 1, -1],
        "shear": turn + np.triu(np.ones((3, 3)), 1),
    }[kind]
    return matrix


@pytest.mark.parametrize("kind", ["similarity", "uneven", "mirror", "shear"])
def test_covariance_goes_with_the_map(kind: str) -> None:
    values, matrix = gaussians(), a_map(kind)
    linear = matrix[:3, :3]
    after = affine.moved(values, matrix)
    np.testing.assert_allclose(covariances(after), linear @ covariances(values) @ linear.T, rtol=1e-4, atol=1e-5)
    expected = values[names.POSITION] @ linear.T + matrix[:3, 3]
    np.testing.assert_allclose(after[names.POSITION], expected, atol=1e-4)
    volume = abs(np.linalg.det(linear)) ** (1 / 3)
    np.testing.assert_allclose(after[names.RADIUS], volume * values[names.RADIUS], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(after[names.ROTATION], axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("kind", ["similarity", "uneven", "mirror", "shear"])
@pytest.mark.parametrize("flat", [False, True])
def test_map_is_found_again(kind: str, flat: bool) -> None:
    places, matrix = gaussians()[names.POSITION], a_map(kind)
    if flat:
        places[:, 2] = 7
    after = affine.moved_places(places, matrix)
    found = affine.fit(places, after)
    assert found is not None
    np.testing.assert_allclose(affine.moved_places(places, found), after, atol=2e-3)
    if not flat:
        np.testing.assert_allclose(found, matrix, atol=1e-4)


def test_one_point_is_shifted_and_a_scattered_crowd_is_no_map() -> None:
    place = np.array([[1, 2, 3]], np.float32)
    found = affine.fit(place, place + 5)
    np.testing.assert_allclose(found, [[1, 0, 0, 5], [0, 1, 0, 5], [0, 0, 1, 5], [0, 0, 0, 1]], atol=1e-6)
    places = gaussians()[names.POSITION]
    after = places.copy()
    after[7] += 1
    assert affine.fit(places, after) is None


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_have_their_quaternion(axis: int) -> None:
    """Where w is nought: the other components must not be divided by it."""
    half = -np.eye(3)
    half[axis, axis] = 1
    expected = np.zeros(4)
    expected[1 + axis] = 1
    np.testing.assert_allclose(np.abs(affine.quaternions_of(half[None])[0]), expected, atol=1e-6)

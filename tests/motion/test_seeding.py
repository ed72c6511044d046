import numpy as np
import pytest

from aa4d.motion.seeding import seeds
from aa4d.motion.tracks import ALWAYS, Array, Tracks

K = np.array([[300.0, 0, 160], [0, 300, 90], [0, 0, 1]])
SIZE = np.array([4.0, 2.0, 1.5])  # of the box that drives


def look_at(eye: Array, target: Array) -> Array:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ eye
    return matrix


def pose_at(t: float) -> tuple[Array, float]:
    """The middle of the footprint and the heading: a curve on a ground that is not at zero."""
    return np.array([-5 + 10 * t, 2 * t * t, 7.0]), 0.8 * t


def silhouette(t: float, viewmat: Array) -> np.ndarray:
    rows, columns = np.mgrid[:180, :320]
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones_like(rows)], -1).reshape(-1, 3) @ np.linalg.inv(K).T
    position, heading = pose_at(t)
    R = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
    eye = (-viewmat[:3, :3].T @ viewmat[:3, 3] - position) @ R
    d = rays @ viewmat[:3, :3] @ R
    lower, upper = np.array([-SIZE[0] / 2, -SIZE[1] / 2, 0]), np.array([SIZE[0] / 2, SIZE[1] / 2, SIZE[2]])
    with np.errstate(divide="ignore"):
        a, b = (lower - eye) / d, (upper - eye) / d
    near, far = np.minimum(a, b).max(1), np.maximum(a, b).min(1)
    return (near <= far).reshape(180, 320)


@pytest.fixture(scope="module")
def driving_box() -> tuple[Tracks, Array, Array]:
    t = np.linspace(0, 1, 9)
    viewmats = np.stack([look_at(np.array([-20 + 40 * s, -25.0, 32.0]), np.array([0.0, 0, 7])) for s in t])
    labels = np.stack([silhouette(s, v) for s, v in zip(t, viewmats, strict=True)]).astype(np.uint16)
    from aa4d.motion.spline import design

    values = np.stack([[*pose_at(s)[0], pose_at(s)[1]] for s in t])
    control = np.linalg.lstsq(design(t, 6), values, rcond=None)[0]
    tracks = Tracks(("box",), control[None], np.array([ALWAYS]), np.array([0.0, 0, 1]), labels, labels > 0)
    return tracks, t, viewmats


def test_seeds_fill_the_box_that_drives(driving_box: tuple[Tracks, Array, Array]) -> None:
    voxel = 0.25
    found, group = seeds(*driving_box, K, voxel)
    assert (group == 0).all()
    inside = (np.abs(found[:, :2]) <= SIZE[:2] / 2) & (found[:, 2:] >= 0) & (found[:, 2:] <= SIZE[2])
    # The hull of outlines that are all from one side bulges towards the cameras and away from them.
    assert 0.9 < len(found) * voxel**3 / np.prod(SIZE) < 4
    assert inside.all(1).sum() * voxel**3 / np.prod(SIZE) > 0.9
    np.testing.assert_allclose(np.median(found, axis=0), [0, 0, SIZE[2] / 2], atol=0.4)


def test_one_wrong_outline_of_nine_does_not_empty_the_hull(driving_box: tuple[Tracks, Array, Array]) -> None:
    tracks, t, viewmats = driving_box
    labels = tracks.labels.copy()
    labels[4] = np.roll(labels[4], 40, axis=1)
    wrong = Tracks(tracks.names, tracks.control, tracks.shown, tracks.up, labels, labels > 0)
    whole, _ = seeds(tracks, t, viewmats, K, 0.25)
    found, _ = seeds(wrong, t, viewmats, K, 0.25)
    assert len(found) > 0.5 * len(whole)


def test_a_mover_without_pixels_has_no_seeds(driving_box: tuple[Tracks, Array, Array]) -> None:
    tracks, t, viewmats = driving_box
    nothing = np.zeros_like(tracks.labels)
    found, group = seeds(
        Tracks(tracks.names, tracks.control, tracks.shown, tracks.up, nothing, nothing > 0), t, viewmats, K, 0.25
    )
    assert found.shape == (0, 3)
    assert group.shape == (0,)

import numpy as np
import pytest

from aa4d.motion.ground import find_ground, project, unproject

K = np.array([[200.0, 0, 80], [0, 200.0, 45], [0, 0, 1]])


def look_at(eye, target):
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = R, -R @ eye
    return view


def scene(slope=0.0, level=0.0, roof=False, bump=0.0):
    """depth_z [V, H, W] of a plane z = level + slope x, with a roof or a hill, by marching along the rays."""
    views = np.stack([look_at([40 * np.sin(a), -40 * np.cos(a), 45 + level], [0, 0, level]) for a in (0, 0.2, 0.4)])
    depths = []
    for view in views:
        v, u = np.mgrid[:90, :160]
        rays = np.stack([(u + 0.5 - 80) / 200, (v + 0.5 - 45) / 200, np.ones(u.shape)], -1) @ view[:3, :3]
        center = -view[:3, :3].T @ view[:3, 3]
        depth = np.zeros(u.shape)
        for z in np.linspace(30, 120, 901):
            p = center + z * rays
            land = level + slope * p[..., 0] + bump * np.exp(-(p[..., 0] ** 2 + p[..., 1] ** 2) / 200)
            if roof:
                land = land + 10.0 * ((np.abs(p[..., 0] - 8) < 6) & (np.abs(p[..., 1]) < 6))
            depth[(depth == 0) & (p[..., 2] <= land)] = z
        depths.append(depth)
    return np.stack(depths).astype(np.float32), views


@pytest.mark.parametrize(("slope", "level", "roof"), [(0.0, 0.0, True), (0.0, 7.0, False), (0.08, 0.0, True)])
def test_the_ground_is_the_plane_below_the_roofs(slope, level, roof):
    depth, views = scene(slope, level, roof)
    ground = find_ground(depth, views, K)
    assert ground.found
    expected = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
    assert ground.up @ expected > np.cos(np.radians(0.7))
    probe = np.array([[x, y, level + slope * x] for x in (-12.0, 0, 10) for y in (-8.0, 0, 8)])
    assert np.abs(ground.above(probe)).max() < 0.3


def test_a_hill_is_followed():
    depth, views = scene(bump=3.0)
    ground = find_ground(depth, views, K)
    assert abs(ground.above(np.array([[0.0, 0, 3.0]]))[0]) < 0.6
    assert abs(ground.above(np.array([[-20.0, 5, 0.0]]))[0]) < 0.6


def test_a_pixel_and_a_height_make_a_point():
    depth, views = scene(slope=0.08)
    ground = find_ground(depth, views, K)
    point = np.array([[5.0, 3.0, 0.4]])
    raised = point + 1.5 * ground.up
    pixels, _ = project(raised, views[1], K)
    assert np.linalg.norm(ground.lift(pixels, views[1], K, 1.5) - raised) < 0.4
    assert np.linalg.norm(ground.drop(raised) - point) < 0.3


def test_rays_above_the_horizon_meet_no_ground():
    depth, _ = scene()
    level = look_at([0.0, -40, 10], [0, 0, 10.0])
    ground = find_ground(*scene(), K)
    assert np.isnan(ground.lift(np.array([[80.0, 20.0]]), level, K)).all()
    assert np.isfinite(ground.lift(np.array([[80.0, 80.0]]), level, K)).all()
    assert depth.shape == (3, 90, 160)


def test_without_any_ground_there_is_a_level_guess_or_none():
    _, views = scene()
    noise = np.random.default_rng(0).uniform(20, 200, (3, 90, 160)).astype(np.float32)
    guess = find_ground(noise, views, K)
    assert not guess.found
    assert np.allclose(guess.up, [0, 0, 1])
    assert find_ground(np.zeros((3, 90, 160), np.float32), views, K) is None


def test_projection_and_its_inverse():
    depth, views = scene()
    rows, columns = np.array([10, 50]), np.array([20, 150])
    pixels, z = project(unproject(depth[0], views[0], K, rows, columns), views[0], K)
    assert np.allclose(pixels, np.stack([columns + 0.5, rows + 0.5], 1))
    assert np.allclose(z, depth[0][rows, columns])

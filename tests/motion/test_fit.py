import numpy as np

from aa4d.motion.fit import Priors, Sightings, fit_track, unwrapped
from aa4d.motion.spline import controls_for, design

UP = np.array([0.0, 0.0, 1.0])
PRIORS = Priors(acceleration_sd=2.0, least_speed=0.2)
FRAMES = 48
CONTROLS = controls_for(FRAMES, 12, 0.5)


def seen(t, position, velocity, sd=0.3):
    size = len(t)
    return Sightings(t, position, np.full(size, sd), velocity, np.full(size, 0.05), np.full(size, np.nan))


def straight(t, speed=0.7):
    frame = t * (FRAMES - 1)
    position = np.stack([speed * frame, 0 * frame + 3, 0 * frame + 7], axis=1)
    return position, np.tile([speed, 0.0, 0.0], (len(t), 1))


def test_a_straight_way_is_met_between_and_beyond_the_sightings():
    t = np.linspace(0.2, 0.8, 20)
    control = fit_track(seen(t, *straight(t)), CONTROLS, FRAMES, UP, PRIORS)
    times = np.linspace(0.1, 0.9, 50)
    assert np.allclose((design(times, CONTROLS) @ control)[:, :3], straight(times)[0], atol=0.02)
    assert np.allclose(control[:, 3], 0, atol=1e-3)


def test_velocities_carry_a_curve_whose_centres_are_noisy():
    t = np.linspace(0, 1, 42)
    angle = t * np.pi / 2
    position = np.stack([20 * np.sin(angle), 20 - 20 * np.cos(angle), 0 * t], axis=1)
    rate = np.pi / 2 / (FRAMES - 1)
    velocity = 20 * rate * np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    noisy = position + np.random.default_rng(0).normal(0, 0.4, position.shape)
    noisy[10] += 15  # a wrong sighting
    control = fit_track(seen(t, noisy, velocity, 0.4), CONTROLS, FRAMES, UP, PRIORS)
    at = design(t, CONTROLS) @ control
    assert np.linalg.norm(at[:, :3] - position, axis=1).max() < 0.4
    assert np.abs(at[2:-2, 3] - angle[2:-2]).max() < 0.05


def test_heading_is_held_while_a_vehicle_stands():
    t = np.linspace(0, 1, FRAMES)
    frame = t * (FRAMES - 1)
    speed = np.clip(np.abs(frame - 23.5) / 4 - 1.5, 0, 1)  # brakes over four frames, stands for ten
    way = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    direction = np.array([0.0, 1.0, 0.0])
    control = fit_track(seen(t, way[:, None] * direction, speed[:, None] * direction), CONTROLS, FRAMES, UP, PRIORS)
    at = design(t, CONTROLS) @ control
    assert np.abs(at[:, 3] - np.pi / 2).max() < 0.05
    assert np.abs(at[:, 1] - way).max() < 0.4


def test_one_sighting_without_velocity_is_a_mover_that_stands():
    one = seen(np.array([0.5]), np.array([[1.0, 2.0, 3.0]]), np.full((1, 3), np.nan))
    control = fit_track(one, CONTROLS, FRAMES, UP, PRIORS)
    assert np.allclose(control[:, :3], [1, 2, 3], atol=1e-6)
    assert np.isfinite(control).all()


def test_a_given_heading_counts_where_nothing_moves():
    t = np.linspace(0, 1, 5)
    still = Sightings(t, np.zeros((5, 3)), np.ones(5), np.zeros((5, 3)), np.ones(5), np.full(5, 1.2))
    assert np.allclose(fit_track(still, CONTROLS, FRAMES, UP, PRIORS)[:, 3], 1.2, atol=1e-3)


def test_headings_go_over_pi_and_survive_backing_up():
    assert np.allclose(unwrapped(np.array([3.0, -3.0])), [3.0, 2 * np.pi - 3.0])
    assert np.allclose(unwrapped(np.array([0.1, 0.1 - np.pi, 0.0])), [0.1, 0.1, 0.0])

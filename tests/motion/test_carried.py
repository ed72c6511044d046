"""Pictures of closed form: a textured square that moves over textured ground seen by a hovering camera."""

from dataclasses import replace

import numpy as np

from aa4d.motion.bodies import body_of
from aa4d.motion.carried import carries, softened, stands
from aa4d.motion.ground import find_ground
from aa4d.motion.observations import Observations
from aa4d.motion.points import Points
from aa4d.motion.standing import misfit
from tests.motion.stage import K, Stage, texture

FRAMES = 8
STEP_PX = 1.5


def scene(light: float = 1.0, driven: bool = True) -> tuple[Observations, Points]:
    """A square of 20 pixels from column 60 on, `light` times as bright from frame 4 on; points that go with it.

    Where it is not `driven`, the pictures show the ground alone, and the points only say that something moves.
    """
    stage = Stage(frames=FRAMES, sweep=0.0)
    observed, _ = stage.observe(noise=0)
    images, skin = observed.images.copy(), texture(3, 20, 50)
    pixels = np.full((9, FRAMES, 2), np.nan, np.float32)
    offsets = np.stack(np.meshgrid([4, 10, 16], [4, 10, 16]), -1).reshape(-1, 2)
    for v in range(FRAMES):
        column = 60 + int(STEP_PX * v)
        if driven:
            bright = light if v >= FRAMES // 2 else 1.0
            images[v, 60:80, column : column + 20] = np.clip(skin * bright, 0, 255)
        pixels[:, v] = offsets + np.array([column + 0.5, 60.5])
    observed = replace(observed, images=images)
    return observed, points_of(observed, pixels)


def points_of(observed: Observations, pixels: np.ndarray) -> Points:
    ground = find_ground(observed.static_depth_m, observed.viewmat, observed.K)
    places = np.stack(
        [
            (ground.lift(pixels[:, v].astype(float), observed.viewmat[v], K) - ground.origin)
            @ ground.axes.T
            / observed.pixel
            for v in range(pixels.shape[1])
        ],
        axis=1,
    ).astype(np.float32)
    return Points(pixels, places, np.ones(pixels.shape[:2], bool), misfit(observed, ground, pixels))


def verdict(observed: Observations, points: Points) -> tuple[bool, bool]:
    body = body_of(points, np.arange(len(points)), np.ones(FRAMES - 1, int))
    ground = find_ground(observed.static_depth_m, observed.viewmat, observed.K)
    soft = softened(observed.images)
    return carries(body, points, observed, ground, soft), stands(body, points, observed, ground)


def test_the_pictures_go_with_a_square_that_moves():
    observed, points = scene()
    assert verdict(observed, points) == (True, False)


def test_a_mover_may_drive_into_the_light():
    observed, points = scene(light=1.4)
    assert verdict(observed, points) == (True, False)


def test_points_that_slide_over_what_stands_are_not_carried():
    observed, points = scene(driven=False)
    assert verdict(observed, points)[0] is False


def test_points_that_keep_their_place_stand_and_say_nothing_against_themselves():
    observed, points = scene()
    still = points_of(observed, np.repeat(points.pixels[:, :1], FRAMES, axis=1))
    assert verdict(observed, still) == (True, True)

"""With the cameras known, what moves is masked, and what only stands high above the ground is not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from aa4d.capture.second_look import moving_pixels, second_mask, without_static
from aa4d.capture.static_depth import Seen, depth_limits, unexplained
from tests.capture import aerial

INDEX = 4
SIZE = (2 * aerial.WIDTH, 2 * aerial.HEIGHT)  # as large as pictures are when motion is looked for
K = np.diag([2, 2, 1]) @ aerial.K
GANTRY = aerial.Surface((-8, 0), 1.2, 12.0, aerial.texture(5, 60))  # static, at a third of the altitude


def car(frame: int) -> aerial.Surface:
    """A roof that drives north, 1.5 m from frame to frame: across the flight, which goes east."""
    paint = np.random.default_rng(9).integers(0, 2, (4, 4, 1)) * 200 + 30  # a light body, dark windows
    texture = np.repeat(np.kron(paint, np.ones((15, 15, 1))), 3, axis=2).astype(np.uint8)
    return aerial.Surface((6, -6 + 1.5 * frame), 1.6, 1.4, texture)


def seen_from(viewmats: list[NDArray[np.float64]], with_car: bool = True) -> Seen:
    def surfaces(frame: int) -> list[aerial.Surface]:
        ground, *roofs = aerial.town()
        return [ground, *([car(frame)] if with_car else []), *sorted([*roofs, GANTRY], key=lambda s: s.z)]

    grid = np.stack(np.meshgrid(np.linspace(-40, 40, 41), np.linspace(-40, 40, 41)), axis=-1).reshape(-1, 2)
    points = np.concatenate([grid, np.zeros((len(grid), 1))], axis=1)
    roofs = np.array([[*s.centre, s.z] for s in surfaces(0) if s.z > 2])
    pictures = [picture(surfaces(i), viewmat) for i, viewmat in enumerate(viewmats)]
    return Seen(pictures, K, np.array(viewmats), np.concatenate([points, roofs]))


def picture(surfaces: list[aerial.Surface], viewmat: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(aerial.picture(surfaces, viewmat, K, SIZE), cv2.COLOR_RGB2GRAY))


def shown(surface: aerial.Surface) -> NDArray[np.bool_]:
    white = replace(surface, texture=np.full((9, 9, 3), 255, np.uint8))
    ground = aerial.Surface((0, 0), 90.0, 0.0, np.zeros((9, 9, 3), np.uint8))
    return picture([ground, white], aerial.arc(sweep_deg=20)[INDEX]) > 127


@pytest.fixture(scope="module")
def off() -> NDArray[np.float32]:
    return unexplained(seen_from(aerial.arc(sweep_deg=20)), INDEX)


def test_a_car_is_masked_and_a_gantry_is_not(off: NDArray[np.float32]) -> None:
    everything = np.ones(off.shape, bool)  # even where the first look took all for moving
    moving = moving_pixels(off, everything)
    assert moving[shown(car(INDEX))].mean() > 0.9
    assert not moving[shown(GANTRY)].any()
    around = cv2.dilate(shown(car(INDEX)).astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    assert moving[~around].mean() < 0.002


def test_patches_that_stand_still_are_let_go_and_those_of_cars_stay(off: NDArray[np.float32]) -> None:
    gantry, cars = (around(surface) for surface in (GANTRY, car(INDEX)))
    assert np.array_equal(without_static(off, gantry | cars), cars)


def test_what_other_frames_do_not_show_stays_masked(off: NDArray[np.float32]) -> None:
    patch = around(GANTRY)
    unseen = np.where(np.arange(off.shape[1]) < np.nonzero(patch.any(axis=0))[0].mean() + 20, 0, off)
    assert np.array_equal(without_static(unseen.astype(np.float32), patch), patch)


def test_a_small_car_of_little_contrast_stays_masked() -> None:
    """As in real frames: its own window is as large as it is, and it disagrees by a pixel only."""
    random = np.random.default_rng(0)
    off = random.uniform(0.05, 0.3, (90, 120)).astype(np.float32)
    first = np.zeros(off.shape, bool)
    first[40:57, 50:67] = True
    off[44:53, 54:63] = random.uniform(0.85, 1.4, (9, 9))
    assert without_static(off, first).sum() == 17 * 17
    assert not moving_pixels(off, first).any(), "too little to be masked for itself"
    off[44:53, 54:63] = 0.4
    assert not without_static(off, first).any()


def test_only_on_demand_is_anything_added() -> None:
    seen = seen_from(aerial.arc(sweep_deg=20))
    nothing = np.zeros(seen.pictures[0].shape, bool)
    assert not second_mask(seen, INDEX, nothing, adds=False).any()
    assert second_mask(seen, INDEX, nothing, adds=True)[shown(car(INDEX))].mean() > 0.8


def around(surface: aerial.Surface) -> NDArray[np.bool_]:
    """A patch as the first look makes it, with a border."""
    return np.asarray(cv2.dilate(shown(surface).astype(np.uint8), np.ones((9, 9), np.uint8))) > 0


def test_what_moves_needs_no_first_look(off: NDArray[np.float32]) -> None:
    assert moving_pixels(off, np.zeros(off.shape, bool))[shown(car(INDEX))].mean() > 0.8


def test_a_static_town_has_no_movers() -> None:
    """At the ends of the clip all other frames look from one side: what roofs hide there is hidden in all of them."""
    seen = seen_from(aerial.arc(sweep_deg=20), with_car=False)
    shares = [moving_pixels(unexplained(seen, i), np.zeros(seen.pictures[0].shape, bool)).mean() for i in (0, INDEX, 8)]
    assert shares[1] == 0
    assert max(shares) < 0.015


def test_a_camera_that_hovers_sees_the_car_alone() -> None:
    seen = seen_from([aerial.arc(1)[0]] * 9)
    moving = moving_pixels(unexplained(seen, INDEX), np.zeros(seen.pictures[0].shape, bool))
    assert 0.002 < moving.mean() < 0.02


def test_a_changed_exposure_is_no_motion() -> None:
    seen = seen_from(aerial.arc(sweep_deg=20), with_car=False)
    darker = [np.asarray(cv2.convertScaleAbs(p, alpha=0.8 if i % 2 else 1.0)) for i, p in enumerate(seen.pictures)]
    moving = moving_pixels(unexplained(replace(seen, pictures=darker), INDEX), np.zeros(darker[0].shape, bool))
    assert moving.mean() < 0.01


def test_fewer_than_five_frames_say_nothing() -> None:
    seen = seen_from(aerial.arc(4, sweep_deg=10))
    assert not unexplained(seen, 1).any()


def test_depths_are_those_of_the_points_around() -> None:
    seen = seen_from(aerial.arc(sweep_deg=20))
    ground = seen.points[seen.points[:, 2] == 0]
    least, most = depth_limits(replace(seen, points=ground), INDEX)
    depths = ground @ seen.viewmats[INDEX, 2, :3] + seen.viewmats[INDEX, 2, 3]
    assert (least > 0.95 / depths.max() - 1e-6).all()
    assert (most < 1.3 / depths.min() + 1e-6).all()
    assert (most > least).all()

"""Ribbons over a picture of level ground, seen from straight above."""

import numpy as np

from aa4d.inspection.trajectories import Trajectory
from aa4d.viewer.cameras import pinhole
from aa4d.viewer.ribbons import HIDDEN, OPACITY_COMING, OPACITY_PAST, ribbon_of, with_ribbons

HEIGHT_M, SIDE = 20.0, 100
CAMERA = pinhole(2 * np.arctan(0.5), SIDE, SIDE)  # 20 m of ground, 5 pixels a metre
DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, HEIGHT_M], [0, 0, 0, 1]])
BLACK = np.zeros((SIDE, SIDE, 3), np.uint8)
GROUND = np.full((SIDE, SIDE), HEIGHT_M, np.float32)


def straight(there: bool = True) -> Trajectory:
    """Along x from -8 m to 8 m."""
    times = np.linspace(0, 1, 17)
    position = np.stack([16 * times - 8, 0 * times, 0 * times], axis=1)
    return Trajectory("car", (1.0, 0.0, 0.0), times, position, np.full(17, there), None)


def test_a_ribbon_is_as_wide_as_it_is_asked_to_be_and_level() -> None:
    ribbon = ribbon_of(straight(), 2.0)
    np.testing.assert_allclose(ribbon.left - ribbon.right, np.tile([0.0, 2.0, 0.0], (17, 1)))


def test_it_lies_where_the_way_goes_and_fades_into_what_is_to_come() -> None:
    drawn = with_ribbons(BLACK, GROUND, DOWN, CAMERA, (ribbon_of(straight(), 2.0),), 0.5)
    red = drawn[..., 0]
    rows, columns = np.nonzero(red)
    assert (rows.min(), rows.max()) == (45, 55)  # a metre to each side of the middle
    assert (columns.min(), columns.max()) == (10, 90)
    assert red[50, 30] == round(255 * OPACITY_PAST)
    assert red[50, 70] == round(255 * OPACITY_COMING)
    assert not drawn[..., 1:].any()


def test_behind_something_it_shines_through() -> None:
    roof = GROUND.copy()
    roof[:, :50] = HEIGHT_M - 5
    red = with_ribbons(BLACK, roof, DOWN, CAMERA, (ribbon_of(straight(), 2.0),), 1.0)[..., 0]
    assert red[50, 30] == round(255 * OPACITY_PAST * HIDDEN)
    assert red[50, 70] == round(255 * OPACITY_PAST)


def test_what_is_not_there_or_behind_the_camera_changes_nothing() -> None:
    absent, way = ribbon_of(straight(there=False), 2.0), ribbon_of(straight(), 2.0)
    up = np.diag([1.0, -1, -1, 1]) @ DOWN  # from the same place, the other way
    for viewmat, ribbons in ((DOWN, ()), (DOWN, (absent,)), (up, (way,))):
        np.testing.assert_array_equal(with_ribbons(BLACK, GROUND, viewmat, CAMERA, ribbons, 0.5), BLACK)


def test_what_stands_still_has_no_ribbon() -> None:
    way = straight()
    still = Trajectory("car", way.color, way.times, 0 * way.position_m, way.there, None)
    np.testing.assert_array_equal(
        with_ribbons(BLACK, GROUND, DOWN, CAMERA, (ribbon_of(still, 2.0),), 0.5)[:40], BLACK[:40]
    )

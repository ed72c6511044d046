import numpy as np
import pytest
from scipy.interpolate import BSpline

from aa4d.motion.spline import controls_for, design


@pytest.mark.parametrize("controls", [4, 5, 11])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_the_spline_is_scipys_uniform_cubic_b_spline(controls: int, derivative: int) -> None:
    control = np.random.default_rng(controls).normal(size=controls)
    segments = controls - 3
    knots = np.arange(-3, segments + 4) / segments
    t = np.linspace(0, 1, 41)[:-1]
    expected = BSpline(knots, control, 3)(t, derivative)
    np.testing.assert_allclose(design(t, controls, derivative) @ control, expected, atol=1e-9 * controls**derivative)


def test_a_straight_line_of_control_points_is_a_straight_line() -> None:
    t = np.linspace(0, 1, 30)
    values = design(t, 8) @ np.arange(8.0)
    np.testing.assert_allclose(np.diff(values), np.diff(values)[0])


def test_segments_last_half_a_second_and_three_frames_at_least() -> None:
    assert controls_for(49, 12.0, 0.5) == 8 + 3
    assert controls_for(10, 2.0, 0.5) == 3 + 3
    assert controls_for(1, 30.0, 0.5) == 4

"""How many pixels are drawn, and when."""

from aa4d.viewer.resolution import COARSEST, MOVING_S, REST_S, SHARP_S, Cost, next_size, size_within

FULL = (1280, 720)


def cost_of(fixed_s: float, each_s: float) -> Cost:
    cost = Cost()
    for width, height in ((320, 180), (640, 360), (1280, 720), (320, 180)):
        cost = cost.observed(width * height, fixed_s + each_s * width * height)
    return cost


def seconds(size: tuple[int, int], fixed_s: float, each_s: float) -> float:
    return fixed_s + each_s * size[0] * size[1]


def test_a_cost_is_the_line_through_what_was_observed() -> None:
    fixed, each = cost_of(0.01, 1e-7).line()
    assert abs(fixed - 0.01) < 1e-6
    assert abs(each - 1e-7) < 1e-11


def test_pictures_of_one_size_put_the_cost_down_to_pixels() -> None:
    cost = Cost().observed(1000, 0.1).observed(1000, 0.1)
    fixed, each = cost.line()
    assert fixed == 0
    assert abs(each - 1e-4) < 1e-9


def test_a_cost_follows_a_machine_that_gets_busy() -> None:
    cost = cost_of(0.01, 1e-8)
    for _ in range(3):
        for pixels in (57_600, 230_400):
            cost = cost.observed(pixels, 4 * (0.01 + 1e-8 * pixels))
    fixed, each = cost.line()
    assert 3 < (fixed + each * 230_400) / (0.01 + 1e-8 * 230_400) < 5


def test_the_size_is_the_largest_that_is_drawn_in_time() -> None:
    fixed, each = 0.01, 1e-7
    size = size_within(MOVING_S, cost_of(fixed, each), FULL)
    assert abs(seconds(size, fixed, each) - MOVING_S) < 0.002
    assert abs(size[0] / size[1] - 16 / 9) < 0.01
    assert size_within(10.0, cost_of(fixed, each), FULL) == FULL


def test_nothing_is_drawn_coarser_than_helps() -> None:
    assert size_within(MOVING_S, cost_of(0.2, 1e-8), FULL) == FULL  # all but nothing goes to pixels
    slow = size_within(MOVING_S, cost_of(0.0, 1e-3), FULL)
    assert slow == (FULL[0] * COARSEST, FULL[1] * COARSEST)


def test_what_moves_is_drawn_at_once_and_what_rests_is_drawn_sharp() -> None:
    fixed, each = 0.01, 1.5e-7
    cost = cost_of(fixed, each)
    coarse = next_size(None, 0.0, cost, FULL)
    assert coarse is not None
    assert coarse[1] == 0
    assert coarse[0] < FULL
    sharp = next_size(coarse[0], 0.0, cost, FULL)
    assert sharp == (FULL, REST_S)
    assert REST_S + seconds(FULL, fixed, each) < 0.3
    assert next_size(coarse[0], 1.0, cost, FULL) == (FULL, 0.0)
    assert next_size(FULL, 1.0, cost, FULL) is None


def test_where_the_whole_picture_takes_longer_there_is_one_in_between() -> None:
    cost = cost_of(0.0, 1e-6)  # the whole takes a second
    coarse = next_size(None, 0.0, cost, FULL)
    assert coarse is not None
    between = next_size(coarse[0], 1.0, cost, FULL)
    assert between is not None
    assert coarse[0] < between[0] < FULL
    assert seconds(between[0], 0.0, 1e-6) < SHARP_S + 0.01
    assert next_size(between[0], 1.0, cost, FULL) == (FULL, 0.0)

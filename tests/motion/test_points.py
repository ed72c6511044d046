import numpy as np

from aa4d.motion.points import longest_run, slips


def along(*x: float) -> np.ndarray:
    return np.stack([np.array(x), np.zeros(len(x))], axis=1)[None].astype(np.float32)


def test_flow_that_slips_off_a_mover_ends_the_point_there():
    onto_the_road = along(0, 4, 8, 12, 12, 12, 12)
    slipped = slips(onto_the_road, np.ones(6, int))
    np.testing.assert_array_equal(slipped[0], [0, 0, 0, 0, 1, 1, 1])
    before = slips(onto_the_road[:, ::-1], np.ones(6, int))
    np.testing.assert_array_equal(before[0], [1, 1, 1, 0, 0, 0, 0])


def test_one_that_brakes_over_some_frames_or_skips_a_frame_is_no_slip():
    assert not slips(along(0, 4, 8, 11, 13, 14.5, 15, 15, 15), np.ones(8, int)).any()
    assert not slips(along(0, 4, 8, 16, 20, 28), np.array([1, 1, 2, 1, 2])).any()


def test_the_longest_of_several_stretches_is_kept():
    alive = np.array([[1, 1, 0, 1, 1, 1, 0], [0, 0, 0, 0, 0, 0, 0]], bool)
    np.testing.assert_array_equal(longest_run(alive), np.array([[0, 0, 0, 1, 1, 1, 0], [0] * 7], bool))

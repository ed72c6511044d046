import numpy as np

from aa4d.motion.score import holds


def test_a_track_holds_what_most_of_its_pixels_show_or_what_it_covers():
    own = np.array([60, 28, 28, 40, 5, 0])
    labelled = np.array([100, 100, 100, 100, 100, 0])
    visible = np.array([300, 30, 90, 300, 5, 30])
    mostly, with_its_shadow, half_a_person, rim_of_a_van, speck_in_a_patch, nothing = holds(own, labelled, visible)
    assert mostly
    assert with_its_shadow
    assert not half_a_person
    assert not rim_of_a_van
    assert not speck_in_a_patch
    assert nothing  # no label lies on anything else

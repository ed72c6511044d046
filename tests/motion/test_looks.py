import numpy as np

from aa4d.motion.looks import joined
from aa4d.motion.tracks import Tracks

SHAPE = (3, 20, 20)


def tracks_at(*columns: int) -> Tracks:
    """A mover of 4 columns at each place."""
    labels = np.zeros(SHAPE, np.uint16)
    for g, column in enumerate(columns):
        labels[:, 5:15, column : column + 4] = g + 1
    control = np.zeros((len(columns), 5, 4))
    control[:, :, 0] = np.array(columns, float)[:, None]
    shown = np.tile([-2.0, -1.0, 2.0, 3.0], (len(columns), 1))
    names = tuple(f"mover {g + 1}" for g in range(len(columns)))
    return Tracks(names, control, shown, np.array([0.0, 0.0, 1.0]), labels, labels > 0)


def test_what_only_the_first_look_saw_is_kept_where_the_clean_scene_lacks_it():
    tracks = joined(tracks_at(0, 8), tracks_at(8), np.ones(SHAPE, bool))
    assert tracks.names == ("mover 1", "mover 2")
    np.testing.assert_array_equal(tracks.control[:, 0, 0], [8, 0])
    assert (tracks.labels[:, 5:15, 0:4] == 2).all()
    assert (tracks.labels[:, 5:15, 8:12] == 1).all()
    assert (tracks.moving >= (tracks.labels > 0)).all()


def test_a_rim_that_the_clean_scene_shows_is_dropped():
    assert len(joined(tracks_at(0, 8), tracks_at(8), np.zeros(SHAPE, bool))) == 1


def test_a_second_look_that_found_nothing_keeps_the_first():
    assert len(joined(tracks_at(0), tracks_at(), np.ones(SHAPE, bool))) == 1

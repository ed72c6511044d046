from aa4d.viewer.playing import Playing

CLIP = Playing(first=1.0, last=5.0, shown=2.0)


def test_time_stands_until_it_runs() -> None:
    assert CLIP.at(100.0) == 2.0
    assert CLIP.run(100.0, is_running=True).at(101.5) == 3.5


def test_it_goes_around_at_the_end() -> None:
    assert CLIP.run(0.0, is_running=True).at(3.5) == 1.5


def test_another_speed_goes_on_from_the_same_moment() -> None:
    slow = CLIP.run(0.0, is_running=True).at_speed(1.0, 0.5)
    assert slow.at(1.0) == 3.0
    assert slow.at(2.0) == 3.5


def test_it_stops_where_it_is_and_goes_where_it_is_put() -> None:
    stopped = CLIP.run(0.0, is_running=True).run(1.0, is_running=False)
    assert stopped.at(50.0) == 3.0
    assert stopped.moved_to(50.0, 4.5).at(60.0) == 4.5
    assert stopped.moved_to(50.0, 9.0).at(60.0) == 5.0


def test_a_clip_of_one_frame_has_one_moment() -> None:
    assert Playing(2.0, 2.0, 2.0).run(0.0, is_running=True).at(9.0) == 2.0

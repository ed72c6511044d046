"""How the timeline maps to the clip, without Blender."""

import pytest

from addon.clip_time import BOUNCE, HOLD, LOOP, ClipTime


@pytest.mark.parametrize(
    ("settings", "ranks"),
    [
        ({}, {0: 0, 1: 0, 1.5: 0.5, 5: 4, 9: 4}),
        ({"start": 11.0}, {11: 0, 12.25: 1.25, 99: 4}),
        ({"speed": 2.0}, {1: 0, 2: 2, 2.25: 2.5, 3: 4}),
        ({"speed": -1.0, "start": 5.0}, {5: 0, 3: 2, 1: 4}),
        ({"reverse": True}, {1: 4, 2.5: 2.5, 5: 0, 9: 0}),
        ({"outside": LOOP}, {5: 4, 5.5: 4, 6: 0, 7.5: 1.5, 0: 4, -1: 3}),
        ({"outside": BOUNCE}, {5: 4, 6: 3, 9: 0, 10: 1, 0: 1}),
        ({"outside": LOOP, "reverse": True}, {1: 4, 6: 4, 7: 3}),
        ({"by_hand": True, "time": 3.5}, {1: 2.5, 100: 2.5}),
        ({"speed": float("nan")}, {7: 0}),
        ({"by_hand": True, "time": float("inf"), "outside": HOLD}, {1: 0}),
    ],
)
def test_rank_of_a_frame(settings: dict[str, object], ranks: dict[float, float]) -> None:
    time = ClipTime(5, **settings)  # type: ignore[arg-type]
    for frame, rank in ranks.items():
        assert time.rank(frame) == pytest.approx(rank)


@pytest.mark.parametrize("outside", [HOLD, LOOP, BOUNCE])
def test_a_clip_of_one_frame_is_at_it(outside: str) -> None:
    assert [ClipTime(1, outside=outside).rank(frame) for frame in (-3.5, 1, 7)] == [0, 0, 0]

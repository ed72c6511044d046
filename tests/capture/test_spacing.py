"""How far movers travel between frames, and the spacing that follows from it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from aa4d.capture.clip import Picture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source, open_source
from aa4d.capture.spacing import SPILL, Pace, Spacing, choose_spacing, followable_until, lengths_of, spacing_advice
from tests.capture.aerial import texture
from tests.capture.videos import write_video

GROUND = (90 + 0.25 * texture(1, 900)).astype(np.uint8)
COLORS = [(230, 230, 230), (200, 30, 30), (30, 30, 40), (240, 200, 40), (40, 80, 200), (245, 245, 245)]
PLACES = [(x, y) for y in (110, 290) for x in (110, 320, 530)]
CAR_PX, LOOP_PX = 60, 60.0


def car(color: tuple[int, int, int]) -> NDArray[np.uint8]:
    """60x24, with a roof between two dark panes."""
    body = np.full((24, 60, 3), color, np.uint8)
    body[3:-3, 14:20] = body[3:-3, 42:48] = 60 if sum(color) > 200 else 160
    return body


def street(time_s: float, lengths_per_s: float) -> NDArray[np.uint8]:
    """640x400: ground that drifts by 10 px a second, and six cars of 60 px, each on its own way of 60 px.

    Ways of one direction would all be epipolar lines of one camera's motion, and then nothing moves.
    """
    shift = np.array([[1, 0, -10 * time_s], [0, 1, -100.0]])
    picture = cv2.warpAffine(GROUND, shift, (640, 400), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    for number, ((x, y), color) in enumerate(zip(PLACES, COLORS, strict=True)):
        angle = np.radians(15 + 60 * number)
        c, s = np.cos(angle), np.sin(angle)
        way = (lengths_per_s * CAR_PX * time_s) % LOOP_PX - 0.5 * LOOP_PX
        middle = np.array([[c, -s], [s, c]]) @ [way - 30, -12]
        place = np.array([[c, -s, x + middle[0]], [s, c, y + middle[1]]])
        body = car(color)
        patch = cv2.warpAffine(body, place, (640, 400), flags=cv2.INTER_LINEAR)
        covered = cv2.warpAffine(np.full(body.shape[:2], 255, np.uint8), place, (640, 400))
        picture[covered > 127] = patch[covered > 127]
    return np.asarray(picture, np.uint8)


def film(frames: int, fps: float, lengths_per_s: float) -> Source:
    times = [i / fps for i in range(frames)]
    pictures = [Picture(str(i), t, i, partial(street, t, lengths_per_s)) for i, t in enumerate(times)]
    return Source("frames", pictures, lambda: times, ())


def test_a_movers_way_is_counted_in_its_own_lengths() -> None:
    """Flow as it is: a car of 60x24 that moves by 6 along itself, and one of 24x60 that is seen from its side."""
    motion = np.zeros((400, 640, 2), np.float32)
    motion[100:124, 200:260] = (6, 0)
    motion[200:260, 300:324] = (-6, 0.3)
    motion[380:, 10:90] = (0, 9)  # the picture's edge cuts it
    moving = np.linalg.norm(motion, axis=2) > 1
    along, across = sorted(lengths_of(moving, motion))
    assert along == pytest.approx(SPILL * 6 / 60, rel=0.1)
    assert across == pytest.approx(SPILL * 6 / 24, rel=0.15)


def test_a_long_film_is_cut_where_its_movers_can_be_followed() -> None:
    """Two lengths a second want frames a quarter of a second apart: of every second one, 150 last 30 s of the 100."""
    chosen = choose_spacing(film(1000, 10, 2.0), Selection(), NOWHERE, lambda *_: None)
    assert chosen.pace is not None
    assert chosen.pace.lengths_per_s == pytest.approx(2.0, rel=0.5)
    assert chosen.end_s is not None
    assert 20 < chosen.end_s < 50
    assert "movers travel about" in chosen.notes[0]


def test_where_nothing_moves_nothing_changes() -> None:
    still = film(4, 10, 0.0)
    assert choose_spacing(still, Selection(), NOWHERE, lambda *_: None) == Spacing(NOWHERE, None, None, ())
    assert choose_spacing(film(1, 10, 1.0), Selection(), NOWHERE, lambda *_: None).pace is None


NOWHERE = Path("nowhere")  # nothing is written there
TIMES = [i / 30 for i in range(1800)]  # a minute


def test_frames_are_taken_so_close_that_movers_travel_half_a_length() -> None:
    pace = Pace(2.0, 1 / 30, 0.0, TIMES[-1])
    end_s, notes = followable_until(pace, TIMES, Selection())
    # Every seventh frame: 0.233 s, 0.47 lengths; 150 of them.
    assert end_s == pytest.approx(150 * 7 / 30, abs=0.03)
    assert "150 frames 0.23 s apart are used, until 35.0 s of 60.0 s" in notes[0]
    # Short enough as it is, or somebody has chosen, or no spacing of the source would do.
    assert followable_until(pace, TIMES[:1000], Selection()) == (None, [])
    assert followable_until(pace, TIMES, Selection(max_frames=50)) == (None, [])
    assert followable_until(pace, TIMES, Selection(end_s=50.0)) == (50.0, [])
    assert followable_until(Pace(40.0, 1 / 30, 0.0, 60.0), TIMES, Selection()) == (None, [])


def test_frames_too_far_apart_are_told_with_what_to_do() -> None:
    pace = Pace(4.2, 1 / 30, 0.0, 21.8)
    used = [0.436 * i for i in range(50)]
    (advice,) = spacing_advice(pace, used, 50)
    assert "travel 1.8 of their own length between the frames used" in advice.what
    assert "use --rate 10 --end 5." in advice.what
    assert spacing_advice(pace, [0.1 * i for i in range(50)], 50) == []
    (advice,) = spacing_advice(Pace(4.2, 0.5, 0.0, 21.8), used, 50)
    assert "cannot be followed. Give 9 frames a second or more" in advice.what


def test_a_video_is_looked_at_and_then_read_from_its_beginning(tmp_path: Path) -> None:
    times = [i / 10 for i in range(24)]
    video = write_video(tmp_path / "film.mp4", [street(t, 2.0) for t in times], times)
    source = open_source(video, Selection(), None)
    chosen = choose_spacing(source, Selection(), NOWHERE, lambda *_: None)
    assert chosen.pace is not None
    assert chosen.pace.lengths_per_s == pytest.approx(2.0, rel=0.5)
    assert chosen.pace.step_s == pytest.approx(0.1)
    assert chosen.notes == ()  # short enough
    assert [p.time_s for p in source.pictures] == pytest.approx(times)

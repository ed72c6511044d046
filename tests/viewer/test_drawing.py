"""The drawing thread: the newest view wins, rest makes sharp, nothing ends it."""

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aa4d.errors import InputError
from aa4d.viewer.cameras import Eye
from aa4d.viewer.drawing import Drawing, Sent
from aa4d.viewer.following import Followed
from aa4d.viewer.pictures import Picture, Wanted
from aa4d.viewer.resolution import Size
from aa4d.viewer.shown import Shown

FULL = (64, 40)
LONG_S = 20.0  # on a machine that does much else


class SlowPainter:
    """Takes as long for a picture as it has pixels."""

    def __init__(self, whole_s: float) -> None:
        self.each_s = whole_s / (FULL[0] * FULL[1])
        self.seconds: list[float] = []  # of the clip that were drawn
        self.fails: Exception | None = None

    def prepare(self, *_: Any) -> None:
        pass

    def picture(self, _shown: tuple[Shown, ...], wanted: Wanted, width: int, height: int) -> Picture:
        self.seconds.append(wanted.second)
        time.sleep(self.each_s * width * height)
        if self.fails is not None:
            raise self.fails
        return Picture(np.full((height, width, 3), round(wanted.second), np.uint8), None, ())


class Window:
    def __init__(self) -> None:
        self.wanted = Wanted(Eye(np.eye(4), 1.0), 1.6, 0.0)
        self.sent: list[Sent] = []
        self.news = threading.Condition()

    def view(self, _now: float) -> tuple[Wanted, Size]:
        return self.wanted, FULL

    def send(self, sent: Sent) -> None:
        with self.news:
            self.sent.append(sent)
            self.news.notify_all()

    def move(self, drawing: Drawing, second: float) -> None:
        self.wanted = replace(self.wanted, second=second)
        drawing.look_again()

    def wait_for(self, second: float, size: Size = FULL) -> None:
        def is_there() -> bool:
            return any(
                s.picture.pixels.shape[1::-1] == size and s.picture.pixels[0, 0, 0] == second for s in self.sent[-1:]
            )

        with self.news:
            assert self.news.wait_for(is_there, LONG_S)


@pytest.fixture
def drawing(toy_run: Path) -> Iterator[Drawing]:
    drawing = Drawing((Followed(toy_run, None).load(),))
    yield drawing
    drawing.stop()


def test_of_many_views_at_once_the_newest_is_drawn_and_few_others(drawing: Drawing) -> None:
    painter, window = SlowPainter(0.2), Window()
    drawing._painter = painter  # type: ignore[assignment]
    drawing.open(1, window.view, window.send)
    drawing.start()
    window.wait_for(0)
    drawn = len(painter.seconds)
    for second in range(1, 201):
        window.move(drawing, second)
    window.wait_for(200)
    assert len(painter.seconds) - drawn < 20


def test_a_view_that_rests_is_drawn_coarse_then_whole_and_then_no_more(drawing: Drawing) -> None:
    painter, window = SlowPainter(0.25), Window()
    drawing._painter = painter  # type: ignore[assignment]
    drawing.open(1, window.view, window.send)
    drawing.start()
    window.wait_for(0)
    window.move(drawing, 7)
    window.wait_for(7)
    sizes = [s.picture.pixels.shape[1::-1] for s in window.sent if s.picture.pixels[0, 0, 0] == 7]
    assert sizes[0] < FULL
    assert sizes == sorted(sizes)
    drawn = len(painter.seconds)
    time.sleep(0.7)
    assert len(painter.seconds) == drawn


def test_every_window_gets_its_turn(drawing: Drawing) -> None:
    windows = [Window(), Window()]
    drawing._painter = SlowPainter(0.02)  # type: ignore[assignment]
    for number, window in enumerate(windows):
        window.wanted = replace(window.wanted, second=float(number))
        drawing.open(number, window.view, window.send)
    drawing.start()
    for number, window in enumerate(windows):
        window.wait_for(number)
    drawing.close(0)
    windows[1].move(drawing, 9)
    windows[1].wait_for(9)
    assert {int(sent.picture.pixels[0, 0, 0]) for sent in windows[0].sent} == {0}, "a window gets its own pictures"


def test_another_model_is_drawn_anew(drawing: Drawing) -> None:
    window = Window()
    drawing._painter = painter = SlowPainter(0.001)  # type: ignore[assignment]
    drawing.open(1, window.view, window.send)
    drawing.start()
    window.wait_for(0)
    before = len(painter.seconds)
    drawing.replace(0, replace(drawing.shown[0], state="further"))
    deadline = time.monotonic() + LONG_S
    while len(painter.seconds) == before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(painter.seconds) > before


def test_what_cannot_be_read_is_said_and_what_fails_ends_nothing(
    drawing: Drawing, capsys: pytest.CaptureFixture[str]
) -> None:
    painter, window = SlowPainter(0.001), Window()
    painter.fails = InputError("000003.png: is missing")
    drawing._painter = painter  # type: ignore[assignment]
    drawing.open(1, window.view, window.send)
    drawing.start()
    with window.news:
        assert window.news.wait_for(lambda: len(window.sent) > 0, LONG_S)
    assert window.sent[0].picture.notes == ("000003.png: is missing",)
    painter.fails = RuntimeError("a fault")
    window.move(drawing, 1)
    time.sleep(0.3)
    painter.fails = None
    window.move(drawing, 2)
    window.wait_for(2)
    assert "RuntimeError: a fault" in capsys.readouterr().err

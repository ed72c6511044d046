"""The thread that draws. It asks each window what is to be seen now, so that nothing ever waits in a queue."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field

from aa4d.errors import InputError
from aa4d.viewer.cameras import Eye
from aa4d.viewer.pictures import Painter, Picture, Wanted, nothing
from aa4d.viewer.resolution import Cost, Size, next_size
from aa4d.viewer.shown import Shown

MOST_A_SECOND = 30.0  # pictures, of what plays by itself
LONGEST_WAIT_S = 0.5

# What a window is to show at a moment, and how large it is; None while it shows nothing.
View = Callable[[float], tuple[Wanted, Size] | None]


@dataclass(frozen=True)
class Sent:
    picture: Picture
    eye: Eye  # that it was drawn for
    seconds: float  # that it took


Send = Callable[[Sent], None]


@dataclass
class _Window:
    view: View
    send: Send
    asked: tuple[Wanted, Size, tuple[Shown, ...]] | None = None  # what was to be seen when it was last asked
    changed_at: float = 0.0  # when that last became something else
    drawn: Size | None = None  # of the picture of just that
    begun_at: float = 0.0  # of the last picture


@dataclass
class Drawing:
    """Windows and the models they show. `start` it once; every method may be called from any thread."""

    shown: tuple[Shown, ...]
    _windows: dict[int, _Window] = field(default_factory=dict)
    _costs: dict[tuple[object, ...], Cost] = field(default_factory=dict)
    _painter: Painter = field(default_factory=Painter)
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _thread: threading.Thread | None = None
    _is_over: bool = False

    def start(self) -> None:
        self._thread = threading.Thread(target=self._draw_all, name="aa4d view: drawing", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Return once the last picture is done."""
        with self._changed:
            self._is_over = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()

    def open(self, window: int, view: View, send: Send) -> None:
        with self._changed:
            self._windows[window] = _Window(view, send)
            self._changed.notify()

    def close(self, window: int) -> None:
        with self._changed:
            self._windows.pop(window, None)

    def look_again(self) -> None:
        """Something that a window shows may have changed."""
        with self._changed:
            self._changed.notify()

    def replace(self, index: int, shown: Shown) -> None:
        """Show another model in the place of one."""
        with self._changed:
            self.shown = (*self.shown[:index], shown, *self.shown[index + 1 :])
            self._changed.notify()

    def _draw_all(self) -> None:
        while True:
            with self._changed:
                due = self._due()
                while due is None and not self._is_over:
                    due = self._due()
                if due is None or self._is_over:
                    return
            self._draw(*due)

    def _due(self) -> tuple[_Window, Wanted, Size] | None:
        """The window that has waited longest, of those whose picture is due; waits where there is none."""
        now = time.monotonic()
        best, wait = None, LONGEST_WAIT_S
        for window in self._windows.values():
            asked = window.view(now)
            if asked is None:
                continue
            wanted, full = asked
            if window.asked != (wanted, full, self.shown):
                window.asked, window.changed_at, window.drawn = (wanted, full, self.shown), now, None
            step = next_size(window.drawn, now - window.changed_at, self._costs.get(_kind(wanted), Cost()), full)
            if step is None:
                continue
            size, later = step
            later = max(later, window.begun_at + 1 / MOST_A_SECOND - now)
            if later > 0:
                wait = min(wait, later)
            elif best is None or window.begun_at < best[0].begun_at:
                best = window, wanted, size
        if best is None:
            self._changed.wait(wait)
        return best

    def _draw(self, window: _Window, wanted: Wanted, size: Size) -> None:
        asked = window.asked
        assert asked is not None
        try:
            self._painter.prepare(asked[2], wanted)
            window.begun_at = time.monotonic()
            picture = self._painter.picture(asked[2], wanted, *size)
            seconds = time.monotonic() - window.begun_at
            window.send(Sent(picture, wanted.eye, seconds))
        except InputError as error:
            window.begun_at = time.monotonic()
            window.send(Sent(nothing(*size, str(error)), wanted.eye, 0.0))
            size, seconds = asked[1], 0.0
        except Exception:  # a window that has just closed, or a fault of ours: the others go on
            traceback.print_exc()
            size, seconds = asked[1], 0.0
        with self._changed:
            if seconds:
                kind = _kind(wanted)
                self._costs[kind] = self._costs.get(kind, Cost()).observed(size[0] * size[1], seconds)
            if window.asked is asked:
                window.drawn = size


def _kind(wanted: Wanted) -> tuple[object, ...]:
    """What the cost of a picture depends on besides its size."""
    return wanted.layer, wanted.models, wanted.arrangement, wanted.ribbons

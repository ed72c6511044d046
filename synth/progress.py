"""Progress with the time that is left: one line that updates on a terminal, sparse lines elsewhere."""

import sys
import time
from typing import TextIO

SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """Counts `total` steps of a stage that takes seconds each."""

    def __init__(self, what: str, total: int, stream: TextIO | None = None) -> None:
        self.what, self.total, self.done = what, total, 0.0
        self.stream = stream or sys.stdout
        self.terminal = self.stream.isatty()
        self.started = self.spoken = time.monotonic()

    def advance(self, share: float = 1.0) -> None:
        """That share of a step is finished."""
        self.done = round(self.done + share, 6)
        now = time.monotonic()
        elapsed = now - self.started
        left = elapsed / self.done * (self.total - self.done)
        last = self.done >= self.total
        ending = f"{_clock(elapsed)} in all" if last else f"{_clock(left)} left"
        text = f"{self.what} {int(self.done)}/{self.total}, {elapsed / self.done:.1f} s each, {ending}"
        if self.terminal:
            self.stream.write(f"\r\033[K{text}" + ("\n" if last else ""))
            self.stream.flush()
        elif last or now - self.spoken >= SECONDS_BETWEEN_LINES:
            print(text, file=self.stream, flush=True)
            self.spoken = now


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"

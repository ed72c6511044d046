"""The time that is shown, as the clock runs."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Playing:
    """Seconds of the clip at a moment; what plays goes around. The clip has the seconds from `first` to `last`."""

    first: float
    last: float
    shown: float  # second of the clip at the moment `since`
    since: float = 0.0  # of a monotonic clock
    speed: float = 1.0
    is_running: bool = False

    def at(self, now: float) -> float:
        if not self.is_running or self.last <= self.first:
            return self.shown
        passed = self.shown - self.first + (now - self.since) * self.speed
        return self.first + passed % (self.last - self.first)

    def run(self, now: float, *, is_running: bool) -> Playing:
        return replace(self, shown=self.at(now), since=now, is_running=is_running)

    def at_speed(self, now: float, speed: float) -> Playing:
        return replace(self, shown=self.at(now), since=now, speed=speed)

    def moved_to(self, now: float, second: float) -> Playing:
        return replace(self, shown=min(max(second, self.first), self.last), since=now)

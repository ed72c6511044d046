"""What a training has taken: seconds on the clock, and of the processor, which other programs alter little."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Spent:
    """Over all stages and sessions of a run."""

    seconds: float = 0.0
    processor_seconds: float = 0.0  # of all threads

    @staticmethod
    def clocks() -> Spent:
        """The two clocks now; only differences of them mean anything."""
        return Spent(time.perf_counter(), time.process_time())

    def since(self, start: Spent) -> Spent:
        return Spent(self.seconds - start.seconds, self.processor_seconds - start.processor_seconds)

    def __add__(self, more: Spent) -> Spent:
        return Spent(self.seconds + more.seconds, self.processor_seconds + more.processor_seconds)

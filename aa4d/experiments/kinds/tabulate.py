"""Scores become tables and a plot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from aa4d import __version__
from aa4d.errors import InputError
from aa4d.experiments.axis import Knob
from aa4d.experiments.kinds.evaluate import Row
from aa4d.files import write_text
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind


@dataclass(frozen=True)
class Entry:
    """What the evaluation with the same place among the task's needs is called in a table."""

    capture: str
    variant: str
    seed: int
    at: float | None = None  # of the experiment's axis

    @property
    def named(self) -> Row:
        """What a row begins with."""
        row: Row = {"capture": self.capture, "variant": self.variant, "seed": self.seed}
        return row if self.at is None else row | {"at": self.at}


@dataclass(frozen=True)
class Tabulation:
    title: str
    entries: tuple[Entry, ...]
    knob: Knob | None = None  # whose axis the entries lie on

    def rows(self, results: Mapping[int, Mapping[str, Any]]) -> list[Row]:
        """Rows of tables.

        Args:
            results: of evaluations, by their places.
        """
        return [entry.named | dict(results[place]) for place, entry in enumerate(self.entries) if place in results]


def run(call: Call) -> dict[str, Any]:
    """Raises InputError where there is no row at all."""
    from aa4d.experiments.tables import write_tables
    from aa4d.experiments.variants import Experiment, Variant

    settings: Tabulation = call.task.settings
    results = {need.task.digest: need.result for need in call.needs}
    places = {place: results[need.digest] for place, need in enumerate(call.task.needs) if need.digest in results}
    rows = settings.rows(places)
    if not rows:
        raise InputError(f"no run came to anything; first: {next(iter(call.failures.values()), 'there is none')}")
    variants = tuple(Variant(label) for label in dict.fromkeys(entry.variant for entry in settings.entries))
    write_tables(Experiment("experiment", settings.title, variants), rows, call.folder, settings.knob)
    if call.failures:
        lines = [f"- {name}: {sentence}\n" for name, sentence in call.failures.items()]
        write_text(call.folder / "failed.md", "".join(lines))
    return {"rows": len(rows)}


KIND = Kind(run, version=__version__)

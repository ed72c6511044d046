"""A run is scored on the held-out frames of its capture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location

Row = dict[str, float | str]


@dataclass(frozen=True)
class Evaluation:
    """Of the run that the task needs first, on the capture that it needs second, or on that at `path`."""

    path: Path | None = location(None)


def run(call: Call) -> dict[str, Any]:
    """The numbers of the scores. Raises what evaluation raises."""
    from aa4d.evaluation.evaluate import evaluate

    settings: Evaluation = call.task.settings
    trained, *captures = call.needs
    metrics = evaluate(trained.folder, settings.path or captures[0].folder, call.advance, into=call.folder)
    return numbers(metrics.as_json())


def numbers(metrics: dict[str, Any]) -> Row:
    """Every number of an evaluation, those of an object as "object.key"; lists, None and the identity are left out."""
    row: Row = {}
    for key, value in metrics.items():
        if key == "identity":
            continue
        if isinstance(value, dict):
            row |= {f"{key}.{inner}": number for inner, number in numbers(value).items()}
        elif isinstance(value, int | float):
            row[key] = value
    return row


KIND = Kind(run, version=__version__)

"""The kind of task that panels are measured by: a function `measure` of a panel's module."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import Task, location


@dataclass(frozen=True)
class Asked:
    module: str
    given: dict[str, Any] = field(default_factory=dict)  # a JSON object
    paths: dict[str, Path] = location(None)  # of what `given` holds digests of


def cost_task(
    module: str,
    name: str,
    given: dict[str, Any] | None = None,
    needs: tuple[Task, ...] = (),
    *,
    seconds: float,
    paths: dict[str, Path] | None = None,
) -> Task:
    """
    Args:
        module: has a function `measure(call)`, which returns a JSON object.
        given: what the function reads from `call.task.settings.given`.
        seconds: that it takes on two cores, roughly: a first estimate, which measured times replace.
    """
    asked = Asked(module, given or {}, paths or {})
    return Task("cost", name, asked, needs, units=seconds, alike=module.rpartition(".")[2])


def run(call: Call) -> dict[str, Any]:
    """Measurements of a panel, and the load average before. Raises what the panel's function raises."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {**import_module(call.task.settings.module).measure(call), "load": load}


KIND = Kind(run, version=__version__)

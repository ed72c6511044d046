"""Tasks: what is to be made, from what, and with how much of a machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from aa4d.graph.kinds import kind_of
from aa4d.identity import Identity, digest_of
from aa4d.settings.allowed import Range

LOCATION = "location"  # metadata of fields that say where something lies, and not what it is


def location(default: Any = dataclasses.MISSING) -> Any:
    """A field of a task's settings that is no part of its identity: where an input lies, how people call it."""
    return field(default=default, metadata={LOCATION: True})


@dataclass(frozen=True)
class Resources:
    """What a task needs of a machine; an engine that shares out several machines goes by it."""

    cores: Annotated[int, Range(1, 4096)] | None = None  # None: one where several tasks run, else as torch likes
    gpus: Annotated[float, Range(0, 64)] = 0.0
    memory_gb: Annotated[float, Range(0, 65536)] = 0.0  # 0: not known


@dataclass(frozen=True)
class Task:
    """Two tasks are the same where their identities are, whatever they are called."""

    kind: str  # of aa4d.graph.kinds.KINDS
    name: str  # for people
    settings: Any  # a frozen dataclass, or a JSON value
    needs: tuple[Task, ...] = ()
    resources: Resources = Resources()
    units: float = 1.0  # how much work it is, compared with those that are alike: iterations, frames
    alike: str = ""  # what its seconds a unit depend on besides the kind: a method and a scene, for instance
    place: str | None = None  # folder of the result; None: one that is named after the kind, the name and the identity
    outputs: tuple[
        str, ...
    ] = ()  # what the result is, of the store's own folder, in which it is made; (): all in `place`
    partial: bool = False  # it is run with those of its needs that came to something

    @cached_property
    def identity(self) -> Identity:
        content = digest_of({"settings": canonical(self.settings), "version": kind_of(self.kind).version})
        return Identity(self.kind, content, {"needs": digest_of([need.digest for need in self.needs])})

    @cached_property
    def digest(self) -> str:
        return self.identity.digest()

    @property
    def title(self) -> str:
        return f"{self.kind} {self.name}"


def canonical(value: Any) -> Any:
    """A JSON value that is equal for equal settings: dataclasses by their fields, without locations."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kept = (f.name for f in dataclasses.fields(value) if not f.metadata.get(LOCATION))
        return {name: canonical(getattr(value, name)) for name in kept}
    if isinstance(value, dict):
        return {str(key): canonical(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [canonical(inner) for inner in value]
    if isinstance(value, Path):
        raise TypeError(f"{value}: a path is no part of an identity; declare its field as a location")
    return value


def in_order(tasks: Iterable[Task]) -> tuple[Task, ...]:
    """The tasks and all that they need, each identity once, what is needed first."""
    found: dict[str, Task] = {}

    def visit(task: Task) -> None:
        if task.digest not in found:
            for need in task.needs:
                visit(need)
            found[task.digest] = task

    for task in tasks:
        visit(task)
    return tuple(found.values())

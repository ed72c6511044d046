"""A knob that an experiment turns: what each of its values makes of a scene, or leaves of a capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from aa4d.errors import InputError
from aa4d.settings.allowed import Count
from aa4d.settings.checking import Place, changed, describe, repeated

Changes = Mapping[str, Any]  # of a scene file: a nested table of the keys that get another value


@dataclass(frozen=True)
class Knob:
    """The axis of a figure."""

    label: str  # with its unit
    log: bool = False


@dataclass(frozen=True, kw_only=True)
class AxisKeys(Knob):
    """The keys of the section `axis`, besides its section `scene`."""

    values: tuple[float, ...]
    keep_every: tuple[Count, ...] = ()  # of the training frames every n-th: an n for each value; empty: all stay


@dataclass(frozen=True)
class Position:
    """A value of the knob, and what it means."""

    at: float
    changes: Changes
    keep_every: int = 1


@dataclass(frozen=True)
class Axis:
    knob: Knob
    positions: tuple[Position, ...]


def axis_of(table: Any, place: Place) -> Axis:
    """
    Raises:
        InputError: an unknown key, a list that has not one entry for each value, a value that stands there twice, or no
            value that changes anything.
    """
    scene = table.get("scene", {}) if isinstance(table, Mapping) else {}
    rest = {key: value for key, value in table.items() if key != "scene"} if isinstance(table, Mapping) else table
    keys = changed(AxisKeys(label="", values=(0.0,)), rest, place)
    values = keys.values
    if not keys.label or "values" not in rest:
        raise InputError(
            f"{place('label' if not keys.label else 'values')}: missing; say what is varied, and its values"
        )
    if (twice := repeated(values)) is not None:
        raise InputError(f"{place('values')}: {twice}")
    if len({f"{value:g}" for value in values}) < len(values):  # as captures, rows and figures name them
        raise InputError(f"{place('values')}: two of them are alike to six digits; leave one out, or take another unit")
    if keys.log and min(values) <= 0:
        raise InputError(f"{place('log')}: {min(values):g} has no logarithm; leave it out, or the value")
    if not scene and not keys.keep_every:
        raise InputError(f"{place('scene')}: missing; say which keys of the scene change, or give keep_every")
    if keys.keep_every and len(keys.keep_every) != len(values):
        raise InputError(f"{place('keep_every')}: needs a number for each of the {len(values)} values")
    thinned = keys.keep_every or (1,) * len(values)
    positions = (
        Position(at, _chosen(scene, i, len(values), "scene", place), thinned[i]) for i, at in enumerate(values)
    )
    return Axis(Knob(keys.label, keys.log), tuple(positions))


def _chosen(table: Any, index: int, count: int, where: str, place: Place) -> dict[str, Any]:
    """The table with the entry `index` of each of its lists."""
    if not isinstance(table, Mapping):
        raise InputError(f"{place(where)}: is a section of keys of the scene file; it cannot be {describe(table)}")
    found: dict[str, Any] = {}
    for key, value in table.items():
        here = f"{where}.{key}"
        if isinstance(value, Mapping):
            found[key] = _chosen(value, index, count, here, place)
        elif isinstance(value, list) and len(value) == count:
            found[key] = value[index]
        else:
            raise InputError(f"{place(here)}: must be a list with an entry for each of the {count} values")
    return found

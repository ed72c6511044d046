"""The settings that a command was given: a file, `--set` and options of its own, in this order; the later ones win."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from aa4d.errors import InputError
from aa4d.settings.checking import Place, changed, describe, one_of, shown
from aa4d.settings.toml import read_toml

T = TypeVar("T")
# By the name of an option of a command, the key that it stands for and its value; None where it is not given.
Options = Mapping[str, tuple[str, Any]]
KEY = re.compile(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*")


@dataclass(frozen=True)
class Given:
    """Tables of settings, each with the place that it comes from."""

    layers: tuple[tuple[Mapping[str, Any], Place], ...] = ()

    @staticmethod
    def by(config: Path | None, assignments: Sequence[str] = (), options: Options | None = None) -> Given:
        """
        Args:
            config: a settings file.
            assignments: "loss.dssim=0.1" and so on.
            options: those of the command that stand for settings.

        Raises:
            InputError: the file cannot be read, an assignment is none, or a key is given twice in one of the three.
        """
        layers: list[tuple[Mapping[str, Any], Place]] = []
        if config is not None:
            layers.append((read_toml(config), lambda where: f"{config}: {where}"))
        layers.append((_assigned(assignments), lambda where: f"--set {where}"))
        table: dict[str, Any] = {}
        named: dict[str, str] = {}
        for option, (key, value) in (options or {}).items():
            if value is not None:
                _put(table, key.split("."), value, option)
                named[key] = option

        def options_of(where: str) -> str:
            """Those that gave a key, or the keys of a section."""
            return ", ".join(option for key, option in named.items() if f"{key}.".startswith(f"{where}.")) or where

        layers.append((table, options_of))
        return Given(tuple(layers))

    def chosen(self, key: str, names: Collection[str], otherwise: str) -> str:
        """Which of `names`, the presets for instance, is asked for under `key` at the top.

        Raises:
            InputError: none of them, or two places ask for different ones: a file that holds every setting of one
                preset would carry the name of another.
        """
        found: dict[str, str] = {}
        for table, place in self.layers:
            if key in table:
                value = table[key]
                if not isinstance(value, str) or value not in names:
                    raise InputError(f"{place(key)}: {describe(value)} must be {one_of(names, value)}")
                found[place(key)] = value
        (first, name), *others = found.items() if found else [("", otherwise)]
        for place_of_other, other in others:
            if other != name:
                raise InputError(f"{place_of_other} {other}: {first} says {name}; leave one of them out")
        return name

    def applied(self, base: T, *, chosen: Collection[str] = (), withheld: Collection[str] = ()) -> T:
        """`base` with everything that is given. Keys in `chosen` have been asked for with `chosen`, those in `withheld`
        have been refused and are not said to be allowed.

        Raises:
            InputError: see `changed`.
        """
        for table, place in self.layers:
            base = changed(base, {key: value for key, value in table.items() if key not in chosen}, place, withheld)
        return base


def _assigned(assignments: Sequence[str]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals or not text or not KEY.fullmatch(key):
            raise InputError(f"--set {shown(assignment)}: write KEY=VALUE, for instance --set seed=1")
        _put(table, key.split("."), _parsed(text), f"--set {key}")
    return table


def _parsed(text: str) -> Any:
    """A value in TOML's syntax; what is none is a text, so that words need no quotes."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text


def _put(table: dict[str, Any], path: Sequence[str], value: Any, who: str) -> None:
    """Enter `value` at `path` among what is there. Raises InputError where something is there already."""
    *sections, last = path
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise InputError(f"{who}: {section} is given already, as {describe(table)}; leave one of them out")
    there = table.get(last)
    if isinstance(there, dict) and isinstance(value, dict):
        for key, inner in value.items():
            _put(there, [key], inner, who)
    elif last in table:
        raise InputError(f"{who}: {last} is given already, as {describe(there)}; leave one of them out")
    else:
        table[last] = value

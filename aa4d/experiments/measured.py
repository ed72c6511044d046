"""A measured table: docs/measured/NAME.json, which says how it was measured, and its form in a page."""

from __future__ import annotations

import re
import string
import textwrap
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.files import read_json_object

WIDTH = 120  # characters of a line in docs/


@dataclass(frozen=True)
class Measured:
    """A table and where it comes from."""

    command: str  # that measures it
    date: str  # YYYY-MM-DD
    machine: str
    load: str  # load average of the machine meanwhile; "" where it changes no figure
    note: str  # a sentence below the table, or ""
    columns: dict[str, str]  # heading: cell, a format string over the row, "{psnr:.2f}"
    rows: list[dict[str, Any]]  # as the command wrote them


def read_measured(path: Path) -> Measured:
    """Raises InputError where the file is absent, lacks a key, has an unknown one or names no command."""
    document = read_json_object(path, "a measured table")
    known = {field.name for field in fields(Measured)}
    if wrong := sorted(known ^ document.keys()):
        fault = "missing" if wrong[0] in known else "unknown"
        raise InputError(f"{path}: key {wrong[0]!r} is {fault}; a measured table has {', '.join(sorted(known))}")
    if not document["command"]:
        raise InputError(f"{path}: 'command' is empty; name the command that measures this table")
    return Measured(**document)


def shown_keys(measured: Measured) -> set[str]:
    """The keys of a row that some column shows."""
    return {key for template in measured.columns.values() for key in _keys(template)}


def _keys(template: str) -> list[str]:
    found = [name for _, name, _, _ in string.Formatter().parse(template) if name is not None]
    return [re.split(r"[.\[]", name)[0] for name in found]


def markdown(measured: Measured) -> str:
    """The table, and below it command, date, machine, load and note.

    Raises:
        InputError: a value cannot be written as its column wants it.
    """
    lines = [list(measured.columns), ["---"] * len(measured.columns)]
    lines += [[_cell(template, row) for template in measured.columns.values()] for row in measured.rows]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    load = f", load average {measured.load}" if measured.load else ""
    note = f" {measured.note}" if measured.note else ""
    source = f"`{measured.command}`; {measured.date}, {measured.machine}{load}.{note}"
    return f"{table}\n\n{textwrap.fill(source, WIDTH, break_long_words=False, break_on_hyphens=False)}\n"


def _cell(template: str, row: dict[str, Any]) -> str:
    """Empty where the row lacks a value."""
    if any(row.get(key) is None for key in _keys(template)):
        return ""
    try:
        return template.format_map(row)
    except KeyError:  # an inner key, of `{lpips[alex]}`
        return ""
    except (ValueError, AttributeError, IndexError, TypeError) as error:
        raise InputError(f"the column {template!r} cannot show {row} ({error})") from None

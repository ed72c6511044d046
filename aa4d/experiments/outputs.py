"""Rows out of the files that commands write: tables of experiments, benchmarks, evaluations."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from aa4d.errors import InputError

ROWS = ("rows", "growth")  # keys of the lists: of experiments, of `aa4d bench train`


def rows_of(output: Path) -> list[dict[str, Any]]:
    """Rows of a CSV table, of a JSON list, or of the list in a JSON object; another object is one row.

    An object's only row also has `run`, the name of its folder.

    Raises:
        InputError: the file is none of these.
    """
    try:
        text = output.read_text(encoding="utf-8")
        value = _csv_rows(text) if output.suffix == ".csv" else json.loads(text)
    except (OSError, ValueError) as error:
        raise InputError(f"{output}: not readable as what a command measured, CSV or JSON ({error})") from None
    if isinstance(value, dict):
        lists = (value[key] for key in ROWS if isinstance(value.get(key), list))
        value = next(lists, [{"run": output.resolve().parent.name, **value}])
    if not isinstance(value, list) or not value or not all(isinstance(row, dict) for row in value):
        raise InputError(f"{output}: holds no rows; give the table.csv, rows.csv or JSON file that the command wrote")
    return value


def _csv_rows(text: str) -> list[dict[str, Any]]:
    return [{key: _value(entry or "") for key, entry in row.items()} for row in csv.DictReader(text.splitlines())]


def _value(text: str) -> str | int | float | None:
    """None where the text is empty; a number where that is written no other way, so that 20.50 keeps its digits."""
    for kind in (int, float):
        try:
            if str(kind(text)) == text:
                return kind(text)
        except ValueError:
            continue
    return text or None

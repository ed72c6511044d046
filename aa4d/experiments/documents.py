"""Measured tables in the pages of docs/: each has a command, and none is written by hand.

    python -m aa4d.experiments.documents render
    python -m aa4d.experiments.documents record NAME OUTPUT... --load 1.2

A page holds a table between `<!-- measured: NAME -->` and `<!-- end -->`; `render` writes it there from
docs/measured/NAME.json. `record` takes the rows of that file from what the command wrote.
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import asdict, replace
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import Positional, arg

from aa4d.cost.machine import processor_name
from aa4d.errors import InputError
from aa4d.experiments.measured import markdown, read_measured, shown_keys
from aa4d.experiments.outputs import rows_of
from aa4d.files import write_json, write_text
from aa4d.words import ONE_OR_MORE

DOCS = Path("docs")
FOLDER = "measured"
BEGIN, END = "<!-- measured: ", "<!-- end -->"
BLOCK = re.compile(rf"{BEGIN}(?P<name>\S+) -->\n((?!{BEGIN}).)*?{END}", re.DOTALL)

Docs = Annotated[Path, arg(help="Folder of the pages.")]


def rendered(page: Path) -> str:
    """The page's text with every measured table current.

    Raises:
        InputError: there is no such table, or a marker lacks its other half.
    """
    text = page.read_text(encoding="utf-8")
    blocks = len(BLOCK.findall(text))
    if text.count(BEGIN) != blocks or text.count(END) != blocks:
        raise InputError(f"{page}: `{BEGIN}NAME -->` and `{END}` stand in pairs, each on a line of its own")
    return BLOCK.sub(lambda block: _block(block["name"], page.parent), text)


def _block(name: str, docs: Path) -> str:
    table = markdown(read_measured(docs / FOLDER / f"{name}.json"))
    return f"{BEGIN}{name} -->\n\n{table}{END}"


def render(docs: Docs = DOCS) -> None:
    """Write every measured table into its page again."""
    for page in sorted(docs.glob("*.md")):
        text = rendered(page)
        if text != page.read_text(encoding="utf-8"):
            write_text(page, text)
            print(f"{page}: written")


def record(
    name: Annotated[Positional[str], arg(help="Of docs/measured/NAME.json, which has the command and the columns.")],
    outputs: Annotated[
        Positional[tuple[Path, ...]],
        arg(help="Files that the command wrote, CSV or JSON.", help_behavior_hint=ONE_OR_MORE),
    ],
    load: Annotated[str, arg(help="Load average of the machine meanwhile.")],
    machine: Annotated[str | None, arg(help="What it ran on; by default this machine.")] = None,
    docs: Docs = DOCS,
) -> None:
    """Take a table's rows from what its command wrote, and render it."""
    path = docs / FOLDER / f"{name}.json"
    table = read_measured(path)
    shown = shown_keys(table)
    found = [nested(row) for output in outputs for row in rows_of(output)]
    rows = [{key: row[key] for key in row if key in shown} for row in found]
    if missing := sorted(shown - {key for row in rows for key in row}):
        raise InputError(f"{path}: a column shows {missing[0]!r}, which no output has")
    write_json(
        path, asdict(replace(table, rows=rows, date=date.today().isoformat(), machine=machine or _machine(), load=load))
    )
    render(docs)


def nested(row: dict[str, Any]) -> dict[str, Any]:
    """A row of a table, whose "lpips.alex" becomes what a column shows as `{lpips[alex]}`."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        outer, dot, inner = key.partition(".")
        if dot:
            found.setdefault(outer, {})[inner] = value
        else:
            found[key] = value
    return found


def _machine() -> str:
    """Threads and processor."""
    return f"{os.cpu_count()} threads of {processor_name()}"


def main() -> None:
    try:
        tyro.extras.subcommand_cli_from_dict({"render": render, "record": record})
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()

"""`aa4d stress`: the table of hard cases, and the search for more."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from aa4d.console import console, step_progress
from aa4d.errors import InputError
from aa4d.files import write_text
from aa4d.settings.checking import one_of

if TYPE_CHECKING:
    from aa4d.stress.cases import Search

ROOT = Path(__file__).resolve().parents[2]


def stress(
    part: Annotated[str | None, arg(metavar="NAME", help="Only this part; without it all of them.")] = None,
    write: Annotated[Path | None, arg(metavar="PATH", help="Page to write the table to.")] = None,
    seed: Annotated[int, arg(help="Seed of the search.")] = 0,
    budget: Annotated[
        float, arg(metavar="SECONDS", help="Time to search for inputs that break a bound, after the table.")
    ] = 0.0,
) -> None:
    """Run the hard cases: inputs on which digits are lost, and what is done about it.

    The exit code is 1 where an error is over its bound. The cases are in the repository, not in the package.
    """
    if not 0 <= budget < 1e6:
        raise InputError(f"--budget {budget}: must be from 0 to 999999 seconds")
    if seed < 0:
        raise InputError(f"--seed {seed}: must be at least 0")
    if write is not None:
        check_page(write, part)
    if not (ROOT / "tests" / "hard_cases").is_dir():
        raise InputError("the hard cases are in the repository: run `aa4d stress` from a checkout (pip install -e .)")
    sys.path.insert(0, str(ROOT))
    all_parts = importlib.import_module("tests.hard_cases").PARTS
    if part is not None and part not in all_parts:
        raise InputError(f"--part {part}: must be {one_of(all_parts, part)}")
    names = list(all_parts) if part is None else [part]
    searches = searches_of(names) if budget > 0 else []
    passes = run(names, all_parts, write)
    finds_nothing = not searches or search(searches, seed, budget)
    if not (passes and finds_nothing):
        sys.exit(1)


def check_page(path: Path, part: str | None) -> None:
    """Raises InputError where a table cannot be written, or would take the place of something else."""
    if not path.parent.is_dir():
        raise InputError(f"--write {path}: there is no folder {path.parent}")
    if path.is_dir():
        raise InputError(f"--write {path}: is a folder; name a file, for instance {path / 'hard-cases.md'}")
    if path.exists() and part is not None:
        raise InputError(f"--write {path}: is there, and would hold {part} alone; name a new file, or leave out --part")
    if path.exists() and not path.read_bytes().startswith(b"# Hard cases"):
        raise InputError(f"--write {path}: is there and no page of hard cases; name another file")


def searches_of(names: list[str]) -> list[Search]:
    """Raises InputError where what the search needs is not installed, or these parts have none."""
    try:
        every: tuple[Search, ...] = importlib.import_module("tests.hard_cases.searches").SEARCHES
    except ModuleNotFoundError as error:
        raise InputError(f'--budget: the search needs {error.name}; pip install -e ".[dev]" brings it') from None
    if chosen := [search for name in names for search in every if search.part == name]:
        return chosen
    able = ", ".join(dict.fromkeys(search.part for search in every))
    raise InputError(f"--budget: {names[0]} has no search; leave it out, or name one of {able} by --part")


def run(names: list[str], titles: Mapping[str, str], write: Path | None) -> bool:
    """Print, and perhaps write, the table of some parts; True where all pass."""
    import torch

    from aa4d.experiments.documents import FOLDER, rendered
    from aa4d.stress.page import as_markdown, row, summary
    from aa4d.stress.runner import run_cases

    torch.set_num_threads(1)  # small problems, which a second thread slows down
    cases = [case for name in names for case in importlib.import_module(f"tests.hard_cases.{name}").PART.cases]
    outcomes = []
    with step_progress("cases") as bar:
        for outcome in run_cases(cases, bar):
            outcomes.append(outcome)
            console.print(row(outcome), highlight=False, soft_wrap=True)
    console.print(summary(outcomes), highlight=False)
    if write is not None:
        has_measured = (write.parent / FOLDER).is_dir()
        write_text(write, as_markdown(outcomes, titles, measured=has_measured))
        write_text(write, rendered(write))
    return all(outcome.passes for outcome in outcomes)


def search(searches: list[Search], seed: int, seconds: float) -> bool:
    """Look for trouble, and print what is found; True where nothing is."""
    from aa4d.stress.search import search_for

    def say(line: str) -> None:
        console.print(line, highlight=False, soft_wrap=True)

    nothing = True
    with step_progress("seconds") as bar:
        for finding in search_for(searches, seed, seconds, say, bar):
            its = finding.search
            say(f"  {finding.tried} inputs, worst error {finding.worst:.1e} of {its.bound:.0e}")
            if finding.example is not None:
                nothing = False
                say(f"  FAIL {finding.reason or 'over its bound'}")
                say(
                    "  the smallest input found, of tests/hard_cases/searches.py: "
                    f"{its.error.__name__}({finding.example!r})"
                )
    return nothing

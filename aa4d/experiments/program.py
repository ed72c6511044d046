"""Measuring programs that are no command of `aa4d`: `python -m aa4d.experiments.NAME`."""

from __future__ import annotations

import sys
from collections.abc import Callable

import tyro

from aa4d.errors import InputError


def run_as_program(main: Callable[..., None]) -> None:
    """Run `main` with the arguments of the command line. Bad input is one sentence, and the exit code is 2."""
    try:
        tyro.cli(main)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)

"""The folder of a training run: one run, one process at a time, nothing half-written."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aa4d import files
from aa4d.errors import InputError
from aa4d.files import read_json_object, write_json
from aa4d.methods import DEFAULT

SETTINGS = "config.json"


def check_folder(out: Path, settings: dict[str, Any]) -> None:
    """Raises InputError where `out` holds something other than the run with these settings."""
    path = out / SETTINGS
    if not path.exists():
        if out.is_dir() and any(not entry.name.startswith(".") for entry in out.iterdir()):
            raise InputError(f"{out}: not empty and not a training run; choose a new folder with --out")
        return
    found = {"method": DEFAULT} | read_json_object(path, "the settings of a training run")
    # Through JSON, so that tuples and lists compare alike.
    wanted = json.loads(json.dumps(settings))
    rides, is_to_ride = (bool(s.get("training", {}).get("motion")) for s in (found, wanted))
    if rides != is_to_ride:
        names = {True: "--motion tracks", False: "--motion none"}
        raise InputError(
            f"{out}: holds a run of {names[rides]}, and {names[is_to_ride]} is asked for (see {path}); "
            "choose a new folder with --out, or delete that one"
        )
    for key in ("method", "capture_fingerprint", "training", "model"):
        if found.get(key) != wanted[key]:
            difference = "capture" if key == "capture_fingerprint" else _difference(found.get(key), wanted[key], key)
            raise InputError(
                f"{out}: holds a run with another {difference} (see {path}); "
                "choose a new folder with --out, or delete that one"
            )


def _difference(found: Any, wanted: Any, name: str) -> str:
    """The first setting that differs, in words."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in wanted | found:
            if found.get(key) != wanted.get(key):
                return _difference(found.get(key), wanted.get(key), f"{name}.{key}")
    return f"{name}: {found} there, {wanted} asked for"


@contextmanager
def claimed(out: Path, settings: dict[str, Any]) -> Iterator[None]:
    """Make the folder this process's own, and write the run's settings there.

    Raises:
        InputError: the folder is not writable, or another process trains there.
    """
    with files.claimed(out, "training"):
        write_json(out / SETTINGS, settings)
        yield

"""The folder of a training run: one run, one process at a time, nothing half-written."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from aa4d import files
from aa4d.capture.reader import Capture
from aa4d.errors import InputError
from aa4d.files import read_json_object, write_json
from aa4d.identity import Identity, digest_of, identity_of
from aa4d.methods import DEFAULT
from aa4d.methods.settings import RunSettings

SETTINGS = "config.json"


def what_counts(settings: RunSettings) -> dict[str, Any]:
    """All settings of a run but those that are off, as before there were such settings."""
    training = asdict(settings)
    if settings.motion is None:
        del training["motion"], training["rates"]["tracks"], training["rates"]["heading"]
    if settings.arithmetic == "float32":
        del training["arithmetic"]
    if not settings.leave_out:
        del training["leave_out"]
    if settings.true_depth == 0:
        del training["true_depth"]
    if not settings.exposure:
        del training["exposure"], training["rates"]["exposures"]
    return training


def run_settings(capture: Capture, method: str, training: dict[str, Any], model: dict[str, Any]) -> dict[str, Any]:
    """What makes a run this one and no other: the content of `config.json`. The path of the capture is for people."""
    settings = json.loads(
        json.dumps({"method": method, "training": training, "model": model})
    )  # tuples become lists, as in the file
    identity = Identity("run", digest_of(settings), {"capture": capture.identity.digest()})
    return {
        "capture": str(capture.folder.resolve()),
        "capture_fingerprint": capture.fingerprint,  # of a run of an older version, which had no identity
        "identity": identity.as_json(),
        **settings,
    }


def run_identity(settings: dict[str, Any]) -> Identity:
    """The identity in a run's settings."""
    identity = identity_of(settings["identity"])
    assert identity is not None
    return identity


def check_folder(out: Path, wanted: dict[str, Any]) -> None:
    """Raises InputError where `out` holds something other than the run with these settings."""
    path = out / SETTINGS
    if not path.exists():
        if out.is_dir() and any(not entry.name.startswith(".") for entry in out.iterdir()):
            raise InputError(f"{out}: not empty and not a training run; choose a new folder with --out")
        return
    found = {"method": DEFAULT} | read_json_object(path, "the settings of a training run")
    if found["method"] != wanted["method"]:
        raise InputError(
            f"{out}: holds a run with another {difference(found['method'], wanted['method'], 'method')} (see {path}); "
            "choose a new folder with --out, or delete that one"
        )
    if not isinstance(found.get("training"), dict):
        raise InputError(f"{path}: is damaged (no settings of a training); put the run's own back, or delete {out}")
    rides, is_to_ride = (bool(s["training"].get("motion")) for s in (found, wanted))
    if rides != is_to_ride:
        names = {True: "--motion tracks", False: "--motion none"}
        raise InputError(
            f"{out}: holds a run of {names[rides]}, and {names[is_to_ride]} is asked for (see {path}); "
            "choose a new folder with --out, or delete that one"
        )
    differences = [difference(found.get(key), wanted[key], key) for key in ("training", "model")]
    if not _has_same_capture(found, wanted):
        differences.insert(0, "capture")
    for different in differences:
        if different is not None:
            raise InputError(
                f"{out}: holds a run with another {different} (see {path}); "
                "choose a new folder with --out, or delete that one"
            )


def _has_same_capture(found: dict[str, Any], wanted: dict[str, Any]) -> bool:
    before = identity_of(found.get("identity"))
    if before is None:
        return bool(found.get("capture_fingerprint") == wanted["capture_fingerprint"])
    return before.made_from.get("capture") == run_identity(wanted).made_from["capture"]


def difference(found: Any, wanted: Any, name: str) -> str | None:
    """The first setting that differs, in words; None where none does."""
    if found == wanted:
        return None
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in wanted | found:
            if found.get(key) != wanted.get(key):
                return difference(found.get(key), wanted.get(key), f"{name}.{key}")
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

"""Settings as TOML: a file read, and a tree of settings written."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.settings.checking import NONE

MOST_BYTES = 1 << 20


def read_toml(path: Path, what: str = "settings file") -> dict[str, Any]:
    """
    Args:
        what: the file is called in messages.

    Raises:
        InputError: there is no file of at most `MOST_BYTES` that is TOML.
    """
    try:
        with path.open("rb") as file:  # no look at its size first: a pipe has none
            content = file.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; name the {what} in it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot read the {what} ({error.strerror})") from None
    if len(content) > MOST_BYTES:
        raise InputError(f"{path}: larger than {MOST_BYTES >> 20} MiB, so no {what}")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))  # some editors begin with a byte order mark
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text, so no {what}") from None
    except (ValueError, RecursionError) as error:  # no TOML, or numbers or nesting without end
        raise InputError(f"{path}: is not TOML: {error}") from None


def as_toml(settings: Any, heading: str, chosen: Mapping[str, str] | None = None) -> str:
    """The whole tree of a dataclass instance, as text from which `Given` makes the same instance again.

    Args:
        heading: a comment to begin with, one line.
        chosen: names that chose the class or the preset, and are no fields of it.
    """
    scalars = [f"{name} = {toml_value(value)}" for name, value in (chosen or {}).items()]
    sections = []
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            inner = [f"{f.name} = {toml_value(getattr(value, f.name))}" for f in dataclasses.fields(value)]
            sections.append("\n".join(["", f"[{field.name}]", *inner]))
        else:
            scalars.append(f"{field.name} = {toml_value(value)}")
    return "\n".join([f"# {heading}", *scalars, *sections]) + "\n"


def toml_value(value: Any) -> str:
    if value is None:
        return toml_value(NONE)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for one character that TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    pairs = (f"{field.name} = {toml_value(getattr(value, field.name))}" for field in dataclasses.fields(value))
    return f"{{ {', '.join(pairs)} }}"

"""A scene file with some keys changed, as another scene file: scenes that differ in one knob are not copied."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aa4d.settings.toml import read_toml, toml_value


def derived(scene: Path, name: str, changes: Mapping[str, Any]) -> str:
    """The text of the scene `name`: `scene` with `changes`. The files that it names lie as seen from `scene`.

    Raises:
        InputError: `scene` cannot be read.
    """
    table = merged(read_toml(scene, "scene file"), changes)
    return "".join(f"{json.dumps(key)} = {_inline(value)}\n" for key, value in (table | {"name": name}).items())


def merged(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`table` with what `changes` says, section by section."""
    found = dict(table)
    for key, value in changes.items():
        before = found.get(key)
        if isinstance(value, Mapping):
            found[key] = merged(before if isinstance(before, Mapping) else {}, value)
        else:
            found[key] = value
    return found


def _inline(value: Any) -> str:
    """Any value of a scene file on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(key)} = {_inline(inner)}' for key, inner in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    return toml_value(value)

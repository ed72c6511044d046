"""How a command is given settings: a file, and `--set`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import UseAppendAction, arg

Config = Annotated[
    Path | None,
    arg(
        metavar="FILE.toml",
        help="Settings that differ from the preset's, for instance the settings.toml that is written beside a result. "
        "--set has the last word over it, and the other options over both. docs/settings.md lists them all.",
    ),
]
Assignments = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(name="set", metavar="KEY=VALUE", help="One setting by its key, for instance seed=1; may be repeated."),
]

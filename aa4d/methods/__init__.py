"""The methods: one folder and one entry each. Nothing outside of this room knows any of them by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

from aa4d.errors import InputError

if TYPE_CHECKING:
    from aa4d.methods.contract import Method
    from aa4d.methods.settings import RunSettings

# The folder of each, by its name; imported on first use, so that the command line starts without torch.
METHODS: dict[str, str] = {
    "adaanchor4d": "aa4d.methods.adaanchor4d",
    "d3dgs": "aa4d.methods.d3dgs",
    "fourdgs": "aa4d.methods.fourdgs",
    "grid4d": "aa4d.methods.grid4d",
    "modec": "aa4d.methods.modec",
    "morel": "aa4d.methods.morel",
    "sdgs": "aa4d.methods.sdgs",
    "sfgs": "aa4d.methods.sfgs",
    "speede": "aa4d.methods.speede",
}
DEFAULT = "adaanchor4d"


def method_of(name: str) -> Method[Any]:
    """The `METHOD` of a folder's module `method`. Raises InputError for a name that is not in `METHODS`."""
    if name not in METHODS:
        raise InputError(f"method {name!r} is unknown; choose one of {', '.join(METHODS)}")
    method: Method[Any] = import_module(f"{METHODS[name]}.method").METHOD
    return method


def presets_of(name: str) -> Mapping[str, RunSettings]:
    """The `PRESETS` of a folder's module `settings`, which needs no torch; `name` is one of `METHODS`."""
    presets: Mapping[str, RunSettings] = import_module(f"{METHODS[name]}.settings").PRESETS
    return presets


def title_of(name: str) -> str:
    """As publications call a method: what the docstring of its folder begins with, up to a bracket or a colon."""
    return re.split(r"\s*[(:]", import_module(METHODS[name]).__doc__ or name)[0]


def preset_names() -> tuple[str, ...]:
    """Those of all methods."""
    return tuple(dict.fromkeys(preset for name in METHODS for preset in presets_of(name)))

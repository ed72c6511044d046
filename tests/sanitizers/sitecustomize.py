"""Puts the native module that AA4D_NATIVE names in the place of the installed one, in every process of `make sanitize`.

Python imports a module of this name by itself where its folder is on PYTHONPATH.
"""

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from types import ModuleType


class Finder:
    """Finds aa4d._native alone."""

    @staticmethod
    def find_spec(
        name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return spec_from_file_location(name, os.environ["AA4D_NATIVE"]) if name == "aa4d._native" else None


sys.meta_path.insert(0, Finder)

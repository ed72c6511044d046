"""Fixtures of the rasteriser's tests; the folder itself is importable, for `raster_scenes`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def subprocess_python() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs code in a fresh interpreter that can import `raster_scenes`."""

    def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
        variables = os.environ | {"PYTHONPATH": str(Path(__file__).parent)} | environment
        return subprocess.run(
            [sys.executable, "-c", code], env=variables, capture_output=True, text=True, timeout=120, check=False
        )

    return run

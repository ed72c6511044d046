"""A small flight with true cameras, and the capture of it: read only."""

from __future__ import annotations

from pathlib import Path

import pytest

from aa4d.capture.summary import CaptureSummary
from tests.capture import aerial
from tests.capture.making import make


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return aerial.write(tmp_path_factory.mktemp("flight") / "frames", aerial.pictures(aerial.arc()))


@pytest.fixture(scope="session")
def made(flight: Path) -> CaptureSummary:
    return make(flight, flight.parent / "capture")

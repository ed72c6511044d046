from pathlib import Path

import pytest

from tests.toy_capture import write_toy_capture


@pytest.fixture
def toy_capture(tmp_path: Path) -> Path:
    """A fresh toy capture that a test may damage."""
    return write_toy_capture(tmp_path / "capture")

from pathlib import Path

import pytest
import torch

from tests.toy_capture import write_toy_capture
from tests.toy_run import train_toy_run


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """Toy problems are too small to share out: a second thread costs them more than it does."""
    torch.set_num_threads(1)


@pytest.fixture
def toy_capture(tmp_path: Path) -> Path:
    """A fresh toy capture that a test may damage."""
    return write_toy_capture(tmp_path / "capture")


@pytest.fixture(scope="session")
def toy_run(tmp_path_factory: pytest.TempPathFactory, one_thread: None) -> Path:  # noqa: ARG001
    """A short run beside its capture; for all tests, so none may change it."""
    return train_toy_run(tmp_path_factory.mktemp("toy"))

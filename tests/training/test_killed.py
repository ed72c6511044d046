"""kill -9 at any moment: the same command continues and ends in the same bits, with no row of history twice."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.model_file import load_model
from aa4d.training.history import COLUMNS
from aa4d.training.run_folder import claimed
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture
from tests.training.short_run import CONFIGS

ROOT = Path(__file__).parent.parent.parent


def silent(*_: object) -> None:
    pass


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Path]]:
    """A capture, and by configuration the run that nothing stopped."""
    folder = tmp_path_factory.mktemp("uninterrupted")
    capture = write_toy_capture(folder / "capture")
    for name, config in CONFIGS.items():
        train(read_capture(capture), folder / name, config, silent)
    return capture, {name: folder / name for name in CONFIGS}


def steps(run: Path) -> list[str]:
    rows = [line.split(",") for line in (run / "history.csv").read_text().splitlines()]
    assert rows[0] == list(COLUMNS)
    return [row[0] for row in rows[1:]]


@pytest.mark.parametrize(
    ("config", "moment", "number"),
    [
        ("paper", "coarse", 17),
        ("paper", "fine", 29),
        ("paper", "checkpoint.safetensors", 2),
        ("paper", "checkpoint.safetensors", 9),
        ("paper", "history.csv", 7),
        ("paper", "coarse.safetensors", 1),
        ("paper", "model.safetensors", 1),
        ("riding", "tracks.npz", 1),
        ("riding", "fine", 29),
        ("seldom", "fine", 9),
    ],
)
def test_a_killed_run_continues_to_the_same_bits(
    uninterrupted: tuple[Path, dict[str, Path]], tmp_path: Path, config: str, moment: str, number: int
) -> None:
    capture, whole = uninterrupted[0], uninterrupted[1][config]
    out = tmp_path / "run"
    arguments = [sys.executable, "-m", "tests.training.short_run", str(capture), str(out), config, moment, str(number)]
    # Sums over anchors depend on how many threads share them: the same bits need the same number.
    environment = os.environ | {"OMP_NUM_THREADS": str(torch.get_num_threads())}
    killed = subprocess.run(arguments, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    said: list[str] = []
    train(read_capture(capture), out, CONFIGS[config], silent, say=said.append)
    assert len(said) == 1
    assert said[0].startswith("continuing at ")
    for name in ("coarse.safetensors", "model.safetensors"):
        expected = load_model(whole / name).model.state_dict()
        found = load_model(out / name).model.state_dict()
        assert expected.keys() == found.keys()
        for key, value in expected.items():
            assert torch.equal(value, found[key]), key
    assert steps(out) == steps(whole) == ["20", "40", "60"]
    assert {path.name for path in out.iterdir()} - {".lock"} == {path.name for path in whole.iterdir()} - {".lock"}


def test_two_processes_do_not_train_in_one_folder(tmp_path: Path) -> None:
    with (
        claimed(tmp_path / "run", {}),
        pytest.raises(InputError, match="another process is training there"),
        claimed(tmp_path / "run", {}),
    ):
        raise AssertionError

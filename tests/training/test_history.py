"""The history of a run and its TensorBoard: every step once, whatever stopped the run."""

import os
import signal
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.training.history import COLUMNS, History
from aa4d.training.trainer import train
from tests.training.short_run import OFTEN_SAVED


def test_tensorboard_shows_each_step_once_after_a_stop(toy_capture: Path, tmp_path: Path) -> None:
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    capture, out = read_capture(toy_capture), tmp_path / "run"

    def interrupt(stage: str, iteration: int, *_: object) -> None:
        if (stage, iteration) == ("fine", 13):
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted):
        train(capture, out, OFTEN_SAVED, interrupt, tensorboard=True)
    train(capture, out, OFTEN_SAVED, lambda *_: None, tensorboard=True)
    events = event_accumulator.EventAccumulator(str(out / "tensorboard"), {"images": 0})
    events.Reload()
    assert [event.step for event in events.Scalars("training/psnr_db")] == [20, 40, 60]
    assert {event.value for event in events.Scalars("training/anchors")} != {0.0}
    images = [event.step for event in events.Images("training/rendered_beside_frame")]
    assert images == sorted(set(images))
    assert (images[0], images[-1]) == (8, 70)
    assert events.Images("training/rendered_beside_frame")[0].width == 2 * 48


def test_rows_after_the_checkpoint_are_forgotten(tmp_path: Path) -> None:
    first = History(tmp_path, 0, tensorboard=False)
    for step in range(1, 61):
        first.add(step, "coarse", step, 1.0 / step, 20.0, 100, 0.1 * step)
    first.write(60)
    again = History(tmp_path, 45, tensorboard=False)
    for step in range(46, 61):
        again.add(step, "coarse", step, 0.5, 30.0, 200, 0.1 * step)
    again.write(60)
    rows = [line.split(",") for line in (tmp_path / "history.csv").read_text().splitlines()]
    assert rows[0] == list(COLUMNS)
    assert [(row[0], row[4], row[5]) for row in rows[1:]] == [
        ("20", "20.0000", "100"),
        ("40", "20.0000", "100"),
        ("60", "30.0000", "200"),
    ]


def test_a_foreign_history_is_started_anew(tmp_path: Path) -> None:
    (tmp_path / "history.csv").write_text("time,value\n1,2\n")
    history = History(tmp_path, 0, tensorboard=False)
    history.write(0)
    assert (tmp_path / "history.csv").read_text() == ",".join(COLUMNS) + "\n"


@pytest.mark.parametrize("row", [b"abc,x\n", b"\n", b"20,coarse\n", b"\xff\xfe\n", b"20,coarse,20,low,20.0,100,1.0\n"])
def test_a_damaged_history_is_refused_and_kept(tmp_path: Path, row: bytes) -> None:
    content = (",".join(COLUMNS) + "\n").encode() + row
    (tmp_path / "history.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"history\.csv: cannot be read as a history .*; delete it"):
        History(tmp_path, 100, tensorboard=False)
    assert (tmp_path / "history.csv").read_bytes() == content

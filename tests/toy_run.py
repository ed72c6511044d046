"""A run on the toy capture that is long enough for everything to be there and to have moved a little."""

from pathlib import Path

from aa4d.capture.reader import read_capture
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import AnchorDensification
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture

BRIEF = AdaAnchor4DSettings(
    preset="test",
    coarse_iterations=20,
    fine_iterations=20,
    voxel_px=3.0,
    rates=PRESETS["quick"].rates,
    densification=AnchorDensification(statistics_from=2, start=5, interval=5, until=15, voxel_factor=4),
)


def silent(*_: object) -> None:
    pass


def train_toy_run(folder: Path) -> Path:
    """`folder`/capture and `folder`/run, which is returned."""
    capture = write_toy_capture(folder / "capture")
    train(read_capture(capture), folder / "run", BRIEF, silent)
    return folder / "run"

"""A short training; as a program one that is killed: `python -m tests.training.short_run CAPTURE OUT CONFIG ...`."""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

from aa4d.capture.reader import read_capture
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import AnchorDensification, MotionSettings
from aa4d.training.trainer import train

SHORT = AdaAnchor4DSettings(
    preset="test",
    coarse_iterations=30,
    fine_iterations=40,
    voxel_px=1.5,
    rates=PRESETS["quick"].rates,
    densification=AnchorDensification(statistics_from=2, start=10, interval=10, until=30, voxel_factor=4),
)
OFTEN_SAVED = replace(SHORT, checkpoint_every=8)
RIDING = replace(OFTEN_SAVED, motion=MotionSettings(tracks="truth"))  # the square of the toy capture is a rigid group
SELDOM_SAVED = replace(SHORT, checkpoint_every=1000)  # but for where a stage ends
CONFIGS = {"paper": OFTEN_SAVED, "riding": RIDING, "seldom": SELDOM_SAVED}


def kill_myself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def train_until(capture: Path, out: Path, config: str, moment: str, number: str) -> None:
    """Killed after an iteration ("coarse" or "fine"), or before the number-th renaming of a file of that name."""
    rename, renamed = Path.replace, []

    def replace_or_die(self: Path, target: Path) -> Path:
        if target.name == moment:
            renamed.append(target)
            if len(renamed) == int(number):
                kill_myself()
        return rename(self, target)

    def progress(stage: str, iteration: int, *_: object) -> None:
        if (stage, str(iteration)) == (moment, number):
            kill_myself()

    Path.replace = replace_or_die  # type: ignore[method-assign, assignment]
    train(read_capture(capture), out, CONFIGS[config], progress)


if __name__ == "__main__":
    train_until(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:6])

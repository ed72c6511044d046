"""The capture folder: is it ours to write, what is there already, and where things go (docs/formats.md)."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError
from synth.files import TEMPORARY_SUFFIX, npz, write_json
from synth.ledger import INDEX, note
from synth.plan import Frame, first_difference

PLAN = "plan.json"
SECOND = "second"  # the folder of the second drone's capture in that of the first


@dataclass(frozen=True)
class Folder:
    """Paths inside a capture folder."""

    root: Path
    encoded: bool = False  # the frames pass through a video: what was developed is kept beside them

    def image(self, frame: Frame) -> Path:
        return self.root / "frames" / f"{frame.name}.png"

    def developed(self, frame: Frame) -> Path:
        """The frame as the sensor gave it."""
        return self.root / "uncompressed" / f"{frame.name}.png" if self.encoded else self.image(frame)

    def truth(self, frame: Frame) -> Path:
        return self.root / "truth" / f"{frame.name}.npz"

    def read_truth(self, frame: Frame) -> dict[str, NDArray[Any]]:
        """The arrays of a frame's truth."""
        with np.load(self.truth(frame), allow_pickle=False) as arrays:
            return dict(arrays)

    def truth_pass(self, name: str, frame: Frame) -> Path:
        """A pass that is computed from the truth of several frames."""
        return self.root / "truth" / name / f"{frame.name}{'.png' if name == 'activity' else '.npz'}"

    def relative(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    def keep(self, path: Path, content: bytes) -> None:
        """Write a file that a later run takes for done, with its digest."""
        note(self.root, self.relative(path), content)

    def keep_arrays(self, path: Path, **arrays: NDArray[Any]) -> None:
        self.keep(path, npz(**arrays))

    def kept(self, frames: Iterable[Frame]) -> list[str]:
        """The files of frames that a run takes for done, by relative path."""
        found = []
        for frame in frames:
            passes = (self.truth_pass(name, frame) for name in ("flow", "occlusion"))
            found += [self.relative(path) for path in (self.developed(frame), self.truth(frame), *passes)]
        return found

    def complete(self, frame: Frame) -> bool:
        """Both files of a frame exist; `ledger.mend` has removed what is not whole."""
        return self.developed(frame).is_file() and self.truth(frame).is_file()


def open_folder(root: Path, plan: dict[str, Any]) -> Literal["new", "unfinished", "finished"]:
    """Claim an output folder for a plan (see `plan.document`); what was half-written before is removed.

    Raises:
        InputError: the folder holds something else, or cannot be written to.
    """
    try:
        state = _state(root, plan)
        if state != "finished":
            root.mkdir(parents=True, exist_ok=True)
            write_json(root / PLAN, plan)
            for leftover in root.rglob(f"*{TEMPORARY_SUFFIX}"):
                leftover.unlink()
    except OSError as error:
        raise InputError(f"{root}: cannot write there: {error.strerror}; choose another folder with --out.") from None
    return state


def _state(root: Path, plan: dict[str, Any]) -> Literal["new", "unfinished", "finished"]:
    if root.exists() and not root.is_dir():
        raise InputError(f"{root}: is a file; --out must name a new or empty folder.")
    if not root.exists() or not any(path.name != PLAN + TEMPORARY_SUFFIX for path in root.iterdir()):
        return "new"
    if not (root / PLAN).is_file():
        raise InputError(f"{root}: is not empty and holds no capture of this scene; choose a new or empty folder.")
    try:
        there = json.loads((root / PLAN).read_text(encoding="utf-8"))
    except ValueError:
        raise InputError(f"{root}: its {PLAN} is damaged; choose a new or empty folder.") from None
    difference = first_difference(plan, there)
    if difference and all(path.name == PLAN for path in root.iterdir()):
        return "new"  # a run that was refused before its first frame
    if difference:
        raise InputError(f"{root}: holds a capture of another plan ({difference}); choose a new or empty folder.")
    return "finished" if (root / INDEX).is_file() else "unfinished"

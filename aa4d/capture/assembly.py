"""The last step: the capture folder is written, checked against the reconstruction, and published whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.placement import Placement
from aa4d.capture.second_look import SecondMasks
from aa4d.capture.selfcheck import ReprojectionError, SelfCheck, check_capture
from aa4d.capture.truth import BOXES, Boxes
from aa4d.capture.undistortion import Pictures
from aa4d.capture.workspace import Progress, Step, StepResult, Workspace
from aa4d.capture.writing import digests_of_written, publish, write_capture

NAME = "capture"


@dataclass(frozen=True)
class Published(StepResult):
    check: SelfCheck
    files: dict[str, str]  # SHA-256 of every file of the capture, by its path

    @classmethod
    def from_json(cls, folder: Path, value: dict[str, Any]) -> Self:
        check = value["check"]
        error = ReprojectionError(**check["reprojection_px"])
        return cls(folder, SelfCheck(**{**check, "reprojection_px": error}), value["files"])


def capture_step(
    path: Path,
    out: Path,
    placement: Placement,
    pictures: Pictures,
    masks: SecondMasks | None,
    left_out: NDArray[np.bool_] | None,
    boxes: Boxes | None,
    generator: dict[str, Any],
    made_from: dict[str, str],
    altitude_m: float | None,
) -> Step[Published]:
    """Make the capture `out` of the input `path`; `generator` is what its index says of how it was made.

    Args:
        masks: of movers, in place of those beside the pictures.
        left_out: [H, W] pixels of all frames that training may leave out.
    """

    def run(folder: Path, progress: Progress) -> Published:
        progress(0, 2)
        name = path.stem if path.is_file() else path.resolve().name
        p = placement
        write_capture(
            folder,
            name,
            pictures.folder,
            p.pinhole,
            p.shots,
            p.cloud,
            generator,
            boxes,
            made_from,
            p.sightings(),
            pictures.folder if masks is None else masks.folder,
            left_out,
        )
        progress(1, 2)
        check = check_capture(folder, placement.observations(), placement.shrinkage)
        files = publish(folder, out)
        progress(2, 2)
        return Published(folder, check, files)

    return Step(NAME, [generator, altitude_m, *([] if boxes is None else [BOXES])], run, Published)


def forget_damaged(out: Path, workspace: Workspace) -> None:
    """Have what is no longer as it was written in the finished capture `out` made anew."""
    written = workspace.earlier(NAME, Published)
    if written is None:
        return
    found = digests_of_written(out)
    damaged = [name for name, digest in written.files.items() if found.get(name) != digest]
    if damaged:
        workspace.forget(NAME)
    if any(name.endswith(".png") for name in damaged):
        workspace.forget("pictures")  # frames/ and movers/ are second names of its files and the second look's

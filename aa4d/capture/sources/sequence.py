"""A sequence of VisDrone or UAVDT: frames whose boxes of vehicles lie beside them, where the data set puts them."""

from __future__ import annotations

from pathlib import Path

from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source, folder


def recognises(path: Path) -> bool:
    return path.is_dir() and annotation_file(path) is not None


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    return folder.open_source(path, selection, annotations or annotation_file(path))


def annotation_file(path: Path) -> Path | None:
    """The file in which the data sets keep the boxes of the sequence in folder `path`; None where there are none.

    VisDrone: SPLIT/sequences/NAME and SPLIT/annotations/NAME.txt. UAVDT: UAV-benchmark-M/NAME and
    UAV-benchmark-MOTD_v1.0/GT/NAME_gt_whole.txt; single-object sequences have NAME_gt.txt beside the frames.
    """
    path = path.resolve()
    candidates = [path.parent.parent / "annotations" / f"{path.name}.txt"]
    for name in (path.name, path.parent.name):
        for kind in ("gt_whole", "gt"):
            file = f"{name}_{kind}.txt"
            candidates += [path.parent / "GT" / file, path.parent / file]
            candidates.append(path.parent.parent / "UAV-benchmark-MOTD_v1.0" / "GT" / file)
    return next((c for c in candidates if c.is_file()), None)

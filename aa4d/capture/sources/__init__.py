"""Inputs of `aa4d capture`: a registry of kinds of input. A new kind is one module and one entry."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from aa4d.capture.clip import Picture
from aa4d.errors import InputError

if TYPE_CHECKING:
    from aa4d.capture.annotations import Annotations
    from aa4d.capture.settings import Selection
    from aa4d.capture.sources.posed import PosedPictures


@dataclass(frozen=True)
class Source:
    """An input that was recognised and opened."""

    kind: str
    pictures: Iterable[Picture]  # in presentation order; can be gone through once
    times_s: Callable[[], list[float]]  # of all pictures, rising, though some may turn out to be damaged
    files: tuple[Path, ...]  # all that the pictures come from: who changes one changes the input
    notes: list[str] = field(default_factory=list)  # what was left out; may grow while pictures are read
    annotations: Annotations | None = None
    posed: PosedPictures | None = None  # where the cameras are known already
    focal_share: float | None = None  # focal length over the longest side, where EXIF has it
    # Of a source whose `pictures` can be gone through once: those from a second on, again.
    again: Callable[[float], Iterable[Picture]] | None = None

    def stamps(self) -> list[tuple[str, int, int]]:
        """Path, size and time of change of every file: what steps that read them depend on."""
        return [(str(f), f.stat().st_size, f.stat().st_mtime_ns) for f in self.files]

    def pictures_from(self, start_s: float) -> Iterable[Picture]:
        """To look at some; `pictures` stays untouched. Earlier ones may come first."""
        return self.pictures if self.again is None else self.again(start_s)


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """Recognise and open `path`.

    Raises:
        InputError: there is nothing, or nothing of a known kind.
    """
    from aa4d.capture.sources import folder, posed, sequence, video

    if not path.exists():
        raise InputError(f"{path}: not found; give a video, a folder of frames, or a COLMAP or nerfstudio folder")
    # The first that recognises the input opens it: from the particular to the general.
    for kind in (posed, sequence, video, folder):
        if kind.recognises(path):
            return kind.open_source(path, selection, annotations)
    raise InputError(f"{path}: neither a video nor a folder with pictures (docs/capture.md lists what can be read)")

"""Whether the binary files of a COLMAP model are whole, told without COLMAP.

From a file that was cut short COLMAP reads counts that are none, and takes all memory or never ends.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pycolmap

POSE = 7 * 8  # a quaternion and a translation


class DamagedError(Exception):
    """A file ends before all that it announces, or has a camera of no known kind."""


class _Reader:
    """Steps through a file's bytes."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def skip(self, size: int) -> None:
        self.at += size
        if self.at > len(self.data):
            raise DamagedError

    def count(self, code: str) -> int:
        """A number of the struct format `code`, little endian."""
        start = self.at
        self.skip(struct.calcsize(f"<{code}"))
        return int(struct.unpack_from(f"<{code}", self.data, start)[0])

    def name(self) -> None:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise DamagedError
        self.at = end + 1


def _camera(file: _Reader) -> None:
    file.skip(4)
    model = file.count("i")
    file.skip(16)
    known = {m.value: m for m in pycolmap.CameraModelId.__members__.values()}
    if model not in known:
        raise DamagedError
    file.skip(8 * len(pycolmap.Camera.create_from_model_id(0, known[model], 1.0, 1, 1).params))


def _image(file: _Reader) -> None:
    file.skip(4 + POSE + 4)
    file.name()
    file.skip(24 * file.count("Q"))


def _point(file: _Reader) -> None:
    file.skip(8 + 24 + 3 + 8)
    file.skip(8 * file.count("Q"))


def _rig(file: _Reader) -> None:
    file.skip(4)
    sensors = file.count("I")
    if sensors:
        file.skip(8)
    for _ in range(sensors - 1):
        file.skip(8)
        if file.count("B"):
            file.skip(POSE)


def _frame(file: _Reader) -> None:
    file.skip(8 + POSE)
    file.skip(16 * file.count("I"))


RECORDS = {"cameras": _camera, "images": _image, "points3D": _point, "rigs": _rig, "frames": _frame}


def damaged(folder: Path) -> str | None:
    """Name of the first of a model's binary files that is cut short or otherwise none; None where all are whole."""
    for name, record in RECORDS.items():
        path = folder / f"{name}.bin"
        if not path.is_file():
            continue
        file = _Reader(path.read_bytes())
        try:
            for _ in range(file.count("Q")):
                record(file)
        except DamagedError:
            return path.name
    return None

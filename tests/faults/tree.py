"""What a folder holds: whether each file is whole, and whether two commands made the same."""

from __future__ import annotations

import csv
import io
import json
import re
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from plyfile import PlyData
from safetensors.numpy import load_file

DAMAGED = "damaged"
NEVER_EMPTY = (".png", ".json", ".ply", ".mp4", ".glb", ".spz", ".usdc", ".npz")
# Of files that say how long something took or when it was made; `total_mib` of one in which that has its digits.
TIMES = re.compile(
    r"(setup|load|picture|truth|clip)_s$|seconds|date|_ms$|fps_|^fps$|memory|threads|cost|load|created|stopped|minutes"
    r"|^frames/s$|^total_mib$"
)
# Of the record of a task and of a trial's row: when files were made, and digests, which times are in.
RECORDS = (frozenset({"files", "sum", "made_from"}), frozenset({"sum", "model"}))
# Their content is not compared: what is in them stands in other files too, beside times and paths, or is a log.
NOT_COMPARED = re.compile(
    r"(^|/)(\.|stopped\.json|cost\.json|events\.jsonl|tensorboard/|.*\.(html|db|blend|svg|md|png\.json)$)|(^|/)(pareto|compare).*\.png$"
)


def unfinished(root: Path) -> list[str]:
    """Files under `root` that cannot be read as what their ending says, or that bear the name of an unfinished one."""
    found = []
    for path in sorted(root.rglob("*")):
        if not path.is_file():
            continue
        name = path.relative_to(root).as_posix()
        # A step of a capture and a task work in a folder of this name until they are done; a task keeps its seconds.
        is_of_task = path.name.endswith(".part.json") and path.with_suffix("").is_dir()
        if (".part" in path.name and not is_of_task) or (".part/" not in name and not is_whole(path)):
            found.append(name)
    return found


def is_whole(path: Path) -> bool:
    try:
        content(path)
    except Exception:
        return False
    return path.name.startswith(".") or path.stat().st_size > 0 or path.suffix not in NEVER_EMPTY


def contents(root: Path) -> dict[str, Any]:
    """What every file under `root` holds, by its path, but for hidden ones and times; DAMAGED for one that is so."""
    paths = (path for path in sorted(root.rglob("*")) if path.is_file())
    names = {path.relative_to(root).as_posix(): path for path in paths}
    return {name: _content_or_damaged(path) for name, path in names.items() if not NOT_COMPARED.search(name)}


def _content_or_damaged(path: Path) -> Any:
    try:
        return content(path)
    except Exception:  # of any library
        return DAMAGED


def content(path: Path) -> Any:
    """Raises an exception of any kind where the file is not whole."""
    data = path.read_bytes()
    match path.suffix:
        case ".png" | ".jpg":
            with Image.open(io.BytesIO(data)) as picture:
                return picture.size, np.asarray(picture).tobytes()
        case ".json":
            return _without_times(json.loads(data))
        case ".csv":
            rows = list(csv.DictReader(io.StringIO(data.decode())))
            return [_without_times(row) for row in rows]
        case ".npz":
            with np.load(io.BytesIO(data)) as file:
                return {name: (file[name].dtype.str, file[name].shape, file[name].tobytes()) for name in file.files}
        case ".safetensors":
            length = struct.unpack("<Q", data[:8])[0]
            texts = json.loads(data[8 : 8 + length]).get("__metadata__", {})
            tensors = {name: (value.shape, value.tobytes()) for name, value in load_file(path).items()}
            return tensors, {key: _without_times(_parsed(text)) for key, text in texts.items()}
        case ".ply":
            return [element.data.tobytes() for element in PlyData.read(io.BytesIO(data)).elements]
        case ".zip" | ".sog":
            with zipfile.ZipFile(io.BytesIO(data)) as file:
                return {entry.filename: entry.CRC for entry in file.infolist()}
        case _:
            return data


def differences(found: dict[str, Any], expected: dict[str, Any]) -> list[str]:
    """Names of files that one of them lacks, or that differ."""
    return sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        for record in RECORDS:
            if value.keys() >= record:
                value = {key: entry for key, entry in value.items() if key not in record}
        return {key: _without_times(entry) for key, entry in value.items() if not TIMES.search(key)}
    return [_without_times(entry) for entry in value] if isinstance(value, list) else value

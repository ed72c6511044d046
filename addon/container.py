"""The safetensors container, read as untrusted bytes with numpy and the standard library.

Eight bytes little-endian header length, a JSON header, the tensors. Nothing is unpickled or executed, and no more
memory is asked for than the file has bytes. Format: https://github.com/huggingface/safetensors
"""

import json
import math
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

DTYPES = {"F32": "<f4", "U32": "<u4", "I32": "<i4", "U16": "<u2", "U8": "u1"}  # safetensors' names, numpy's
LONGEST = 1000  # characters of a sentence: a value of a file that it quotes may be of any length
HEADER_LIMIT = 100_000_000  # bytes; the limit of the safetensors format itself


class ModelFileError(Exception):
    """A model file cannot be used. The message is one sentence for the person who chose the file."""

    def __str__(self) -> str:
        """The sentence; a file's name may hold bytes that are no text, which Blender cannot show. Of an endless one the
        beginning and the end."""
        said = " ".join(super().__str__().encode(errors="replace").decode().splitlines())
        return said if len(said) <= LONGEST else f"{said[: LONGEST // 2]} ... {said[-LONGEST // 2 :]}"


@dataclass(frozen=True)
class Entry:
    """One tensor: where its bytes lie in the file."""

    shape: tuple[int, ...]
    start: int  # from the beginning of the file
    dtype: str = "F32"


@dataclass(frozen=True)
class Header:
    """The checked header of a container."""

    metadata: Mapping[str, str]
    entries: Mapping[str, Entry]


def read_metadata(path: Path) -> Mapping[str, str]:
    """The texts in the header, before anything is known of the tensors.

    Raises:
        ModelFileError: the file is missing, cut short in its header, or not a safetensors file.
    """
    return _read_json(path)[0]


def read_header(path: Path, dtypes: Collection[str] = ("F32",)) -> Header:
    """Read the header; check that the tensors fill the rest of the file without gap or overlap.

    Raises:
        ModelFileError: the file is missing, cut short, or not a safetensors file of tensors of these types alone.
    """
    metadata, tensors, data_start, size = _read_json(path)
    spans = sorted(_span(path.name, name, value, size - data_start, dtypes) for name, value in tensors.items())
    end = 0
    for begin, stop, name, *_ in spans:
        if begin != end:
            problem = "overlaps the tensor before it" if begin < end else "leaves unnamed bytes before it"
            raise ModelFileError(f"{path.name} is damaged: tensor {name} {problem}.")
        end = stop
    if end != size - data_start:
        raise ModelFileError(f"{path.name} is damaged: {size - data_start - end} unnamed bytes follow the last tensor.")
    return Header(metadata, {name: Entry(shape, data_start + begin, dtype) for begin, _, name, shape, dtype in spans})


def _read_json(path: Path) -> tuple[dict[str, str], dict[str, Any], int, int]:
    """The header's metadata and tensors, where the tensors begin, and the size of the file."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            length = int.from_bytes(file.read(8), "little")
            first = file.read(1)
            if size < 9 or first != b"{":
                raise ModelFileError(f"{path.name} is not a safetensors file; choose the model.safetensors of a run.")
            if length > HEADER_LIMIT:
                raise ModelFileError(f"{path.name} announces a header of {length} bytes; at most {HEADER_LIMIT} fit.")
            if length > size - 8:
                raise ModelFileError(f"{path.name} is cut short: its header alone needs {length + 8} of {size} bytes.")
            text = first + file.read(length - 1)
    except OSError as error:
        raise ModelFileError(f"{path.name} cannot be read: {error.strerror or error}.") from error
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path.name} has a damaged header: it is not JSON.") from error
    metadata = header.pop("__metadata__", {})
    if not isinstance(metadata, dict) or not all(isinstance(value, str) for value in metadata.values()):
        raise ModelFileError(f"{path.name} has a damaged header: __metadata__ must map names to strings.")
    return metadata, header, 8 + length, size


def _span(
    file_name: str, name: str, value: Any, available: int, dtypes: Collection[str]
) -> tuple[int, int, str, tuple[int, ...], str]:
    """The checked (begin, end, name, shape, dtype) of one header entry; offsets from the start of the data."""
    try:
        dtype, shape, (begin, end) = value["dtype"], value["shape"], value["data_offsets"]
        numbers = [*shape, begin, end]
    except (TypeError, KeyError, ValueError) as error:
        raise ModelFileError(
            f"{file_name} has a damaged header: tensor {name} lacks its type, shape or offsets."
        ) from error
    if not all(type(number) is int and number >= 0 for number in numbers):
        raise ModelFileError(f"{file_name} has a damaged header: tensor {name} has an impossible shape or offset.")
    if not isinstance(dtype, str) or dtype not in dtypes:
        known = ", ".join(dtypes)
        raise ModelFileError(
            f"{file_name}: tensor {name} is of type {str(dtype)[:20]}; such a file holds {known} alone."
        )
    if end > available:
        raise ModelFileError(f"{file_name} is cut short: tensor {name} ends {end - available} bytes after the file.")
    if end - begin != np.dtype(DTYPES[dtype]).itemsize * math.prod(shape):
        raise ModelFileError(f"{file_name} has a damaged header: the bytes of tensor {name} do not fit its shape.")
    return begin, end, name, tuple(shape), dtype


def read_tensors(path: Path, entries: Mapping[str, Entry], names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
    """Read the named tensors; every value must be finite.

    Raises:
        ModelFileError: the file changed under the reader, or a tensor holds NaN or infinity.
    """
    tensors: dict[str, npt.NDArray[Any]] = {}
    try:
        with path.open("rb") as file:
            for name in names:
                shape, kind = entries[name].shape, np.dtype(DTYPES[entries[name].dtype])
                file.seek(entries[name].start)
                size = kind.itemsize * math.prod(shape)
                data = file.read(size)
                if len(data) != size:
                    raise ModelFileError(f"{path.name} is cut short in tensor {name}.")
                tensors[name] = np.frombuffer(data, kind).reshape(shape).astype(kind.newbyteorder("="), copy=False)
    except OSError as error:
        raise ModelFileError(f"{path.name} cannot be read: {error.strerror or error}.") from error
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            raise ModelFileError(f"{path.name}: tensor {name} holds values that are not finite; train the model again.")
    return tensors

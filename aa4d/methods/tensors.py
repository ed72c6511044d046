"""Named tensors of a file."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from aa4d.errors import InputError


def tensor_of(tensors: dict[str, Tensor], name: str, path: Path) -> Tensor:
    """As float32. Raises InputError where it is missing."""
    if name not in tensors:
        raise InputError(f"{path}: tensor {name!r} is missing; train the model again")
    return tensors[name].float()

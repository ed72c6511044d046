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


def check_like(value: Tensor, expected: Tensor, name: str) -> None:
    """Raises ValueError where a tensor of a file has another shape or type than what it is to take the place of."""
    if value.shape != expected.shape or value.dtype != expected.dtype:
        found, right = (f"{tuple(v.shape)} {v.dtype}" for v in (value, expected))
        raise ValueError(f"{name} is {found}, expected {right}")

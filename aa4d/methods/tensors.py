"""Named tensors of a file."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from aa4d.errors import InputError
from aa4d.kernels.plane_lookup import PLANES

MAX_LEVELS = 8


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


def plane_sizes(tensors: dict[str, Tensor], field: str, path: Path) -> tuple[int, tuple[int, ...], int]:
    """Channels, cells a side of each level, and rows along t of a field's planes, as their shapes tell.

    Args:
        field: its name in the state; planes are `field.planes.{level}.{plane}`, [R2, R1, C].

    Raises:
        InputError: a plane is missing.
        ValueError: a plane has no three axes, or there are more than `MAX_LEVELS` levels.
    """
    levels = sum(name.startswith(f"{field}.planes.") and name.endswith(".xy") for name in tensors)
    if not 1 <= levels <= MAX_LEVELS:
        raise ValueError(f"{field} has {levels} levels")
    shapes = []
    for level in range(levels):
        shape, *others = (tensor_of(tensors, f"{field}.planes.{level}.{plane}", path).shape for plane in PLANES[::-1])
        if any(len(of) != 3 for of in (shape, *others)):
            raise ValueError(f"a plane of {field} has {len(shape)} axes")
        shapes.append(shape)
    return shapes[0][2], tuple(shape[1] for shape in shapes), shapes[0][0]

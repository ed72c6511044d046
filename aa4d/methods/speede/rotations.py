"""Rotations as vectors: the exponential map, its inverse, and the rotation that best turns points into others."""

from __future__ import annotations

import torch
from torch import Tensor

SMALL = 1e-12  # squared angle, below which a series takes the place of a quotient


def matrix_of(turn: Tensor) -> Tensor:
    """Rotation vectors [..., 3] in radians -> matrices [..., 3, 3] (Rodrigues)."""
    squared = turn.square().sum(-1)
    small = squared < SMALL
    safe = torch.where(small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    first = torch.where(small, 1 - squared / 6, angle.sin() / angle)[..., None, None]
    second = torch.where(small, 0.5 - squared / 24, (1 - angle.cos()) / safe)[..., None, None]
    x, y, z = turn.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    return torch.eye(3, dtype=turn.dtype, device=turn.device) + first * cross + second * (cross @ cross)


def turn_of(matrix: Tensor) -> Tensor:
    """Matrices [..., 3, 3] of rotations by less than half a turn -> rotation vectors [..., 3]."""
    skew = (matrix - matrix.mT) / 2
    axis = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)  # times the angle's sine
    cosine = (matrix.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    squared = axis.square().sum(-1)
    small = squared < SMALL
    sine = torch.where(small, torch.ones_like(squared), squared).sqrt()
    factor = torch.where(small, 1 + squared / 6, torch.atan2(sine, cosine) / sine)
    return axis * factor[..., None]


def best_rotations(start: Tensor, end: Tensor) -> Tensor:
    """Matrices [T, 3, 3] that turn points [P, 3] nearest to [P, T, 3], both about their means (Kabsch)."""
    a, b = start - start.mean(0), end - end.mean(0)
    u, _, vt = torch.linalg.svd(torch.einsum("pi,ptj->tij", a, b))
    flip = torch.ones_like(u[..., 0])
    flip[..., 2] = torch.linalg.det(vt.mT @ u.mT).sign()
    return (vt.mT * flip[..., None, :]) @ u.mT

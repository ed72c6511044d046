"""Key frames, their windows of time, and what a key frame weighs at a time."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

BEFORE, AFTER = 0, 1  # columns of what is learned for each direction of time, seen from the key frame
SOFTPLUS_OF_ONE = 0.5413248546129181  # log(e - 1): where softplus is 1


def key_time(key: int, keys: int) -> float:
    """t_n: `keys` of them cover [0, 1] evenly, the first and the last instant included."""
    return key / (keys - 1)


def neighbours(t: float, keys: int) -> tuple[int, int]:
    """The key frames before and after t; an instant that is a key frame begins the interval after it."""
    lower = min(int(t * (keys - 1)), keys - 2)
    return lower, lower + 1


def nearest(t: float, keys: int) -> int:
    return min(int(t * (keys - 1) + 0.5), keys - 1)


def local_time(t: float, key: int, keys: int) -> float:
    """tau = (t - t_n) / GOP: -1 and 1 are the key frames before and after; beyond them it stays there."""
    return min(max(t * (keys - 1) - key, -1.0), 1.0)


def linear_weight(tau: float) -> float:
    """Of a key frame where nothing is learned yet: the two that an instant lies between have 1 together."""
    return 1 - abs(tau)


def learned_weight(tau: float, center: Tensor, decay: Tensor, strength: float) -> Tensor:
    """w = exp(-lambda_decay d |tau - o|), [N].

    Args:
        center, decay: [N, 2] o and d before softplus, by direction.
        strength: lambda_decay.
    """
    direction = AFTER if tau >= 0 else BEFORE
    distance = (tau - center[:, direction]).abs()
    return torch.exp(-strength * F.softplus(decay[:, direction]) * distance)

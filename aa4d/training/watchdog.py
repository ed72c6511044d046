"""Where a first NaN or infinity came from."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor
from torch.optim import Adam


class NotFinite(Exception):  # noqa: N818, a finding, not an error of the program
    """A value that training cannot go on with."""

    def __init__(self, what: str, groups: tuple[str, ...] = ()) -> None:
        """`what` was found: "the loss", "a gradient"; `groups`: the parameter groups that hold it, where known."""
        super().__init__(what)
        self.what = what
        self.groups = groups


# Looks at gradients ("a gradient") or at what the optimiser has just changed ("a parameter"); raises NotFinite.
Watch = Callable[[Adam, str], None]


def check_finite(optimiser: Adam, what: str) -> None:
    """Raises NotFinite with the groups whose gradients, or whose parameters and moments, are not finite.

    It reads every value, which costs as much as an optimiser step: training does so only before it writes a
    checkpoint, and in every iteration when it repeats the last ones to find out where a value came from.
    """

    def values(parameter: Tensor) -> Iterable[Tensor]:
        if what == "a gradient":
            return () if parameter.grad is None else (parameter.grad,)
        return (parameter, *(v for v in optimiser.state.get(parameter, {}).values()))

    groups = tuple(
        group["name"]
        for group in optimiser.param_groups
        if any(not torch.isfinite(v).all() for parameter in group["params"] for v in values(parameter))
    )
    if groups:
        raise NotFinite(what, groups)


def advice(groups: tuple[str, ...]) -> str:
    if not groups:
        return "check the poses and images of the capture"
    return f"lower the learning rate of {groups[0]!r}: --set rates.{groups[0]}.initial=..."

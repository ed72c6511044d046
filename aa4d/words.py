"""Numbers of things in words."""

from __future__ import annotations


def counted(count: int, what: str) -> str:
    """ "1 run", "3 runs"."""
    return f"{count} {what}{'' if count == 1 else 's'}"

"""Words for people: numbers of things, names in figures."""

from __future__ import annotations


def counted(count: int, what: str) -> str:
    """ "1 run", "3 runs"."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def in_figure(text: str) -> str:
    """A name or a title for matplotlib, which takes what stands between two dollar signs for mathematics."""
    return text.replace("$", r"\$")

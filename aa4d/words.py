"""Words for people: numbers of things, names in figures."""

from __future__ import annotations

# What help says of an argument that takes several, in place of a default: an empty one would read "(default: )".
ONE_OR_MORE, ANY_NUMBER = "(one or more)", "(any number)"


def counted(count: int, what: str) -> str:
    """ "1 run", "3 runs"."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def in_figure(text: str) -> str:
    """A name or a title for matplotlib, which takes what stands between two dollar signs for mathematics, and leaves
    out of a legend what begins with an underscore, unless a blank of no width stands before it."""
    literal = text.replace("$", r"\$")
    return f"\u200b{literal}" if literal.startswith("_") else literal

"""Identities: what an artefact holds and what it was made from (docs/formats.md, "Identity")."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

VERSION = 1  # of how the digests below are computed


@dataclass(frozen=True)
class Identity:
    """Two artefacts are the same where their identities are equal, wherever their files lie."""

    kind: str  # "capture", "run", "model", "evaluation", "export", "render" or "report"
    content: str  # digest of what it holds, or of the settings that it depends on
    made_from: Mapping[str, str] = field(default_factory=dict)  # digest of each source by its kind

    def as_json(self) -> dict[str, Any]:
        return {"kind": self.kind, "version": VERSION, "content": self.content, "made_from": dict(self.made_from)}

    def as_text(self) -> str:
        """One line, for the headers of other formats."""
        return json.dumps(self.as_json(), sort_keys=True)

    def digest(self) -> str:
        """SHA-256 of the identity as one word, by which what is made from the artefact names it."""
        return digest_of(self.as_json())


def identity_of(value: Any) -> Identity | None:
    """An identity that stands in a file; None where there is none that can be read."""
    try:
        kind, content, made_from = value["kind"], value["content"], dict(value["made_from"])
    except (KeyError, TypeError, ValueError):
        return None
    if value.get("version") != VERSION or not all(isinstance(v, str) for v in (kind, content, *made_from.values())):
        return None
    return Identity(kind, content, made_from)


def digest_of(value: Any) -> str:
    """SHA-256 of a JSON value: keys sorted, no spaces, ASCII, numbers as Python writes them."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def digest_of_file(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

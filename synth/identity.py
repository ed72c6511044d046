"""A capture's identity (docs/formats.md, "Identity"): what it holds, and the plan that it was made from."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

VERSION = 1


def digest_of(value: Any) -> str:
    """SHA-256 of a JSON value: keys sorted, no spaces, ASCII, numbers as Python writes them."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def capture_identity(
    index: Mapping[str, Any], files: Mapping[str, str], made_from: Mapping[str, str]
) -> dict[str, Any]:
    """The value of the key `identity` of capture.json.

    Args:
        index: the other content of capture.json; an identity that it has already does not count.
        files: SHA-256 by path, the content of checksums.json.
        made_from: {"plan": the plan's own SHA-256}.
    """
    held = {key: value for key, value in index.items() if key not in ("identity", "generator")}
    content = digest_of({"index": held, "files": dict(files)})
    return {"kind": "capture", "version": VERSION, "content": content, "made_from": dict(made_from)}

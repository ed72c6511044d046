"""One part of the check in a process of its own: `python -m tests.device.one_part PART FOUND.json ASKED`.

A kernel that fails can leave CUDA unusable for the rest of a process, and one that hangs can only be killed.
"""

from __future__ import annotations

import json
import math
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

from tests.device.asked import asked_of


def plain(value: Any) -> Any:
    """The value as JSON has it: what is not finite becomes text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return value


def main(part: str, path: Path, asked: str) -> int:
    """What the part found is in the file after each of its measurements; 1 where it raised, and then its traceback."""
    found: dict[str, Any] = {}

    def keep(name: str, value: Any) -> None:
        found[name] = plain(value)
        beside = path.with_suffix(".part")
        beside.write_text(json.dumps(found))
        beside.replace(path)

    try:
        import_module(f"tests.device.{part}").measure(asked_of(asked), keep)
    except Exception:
        keep("traceback", traceback.format_exc())
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), sys.argv[3]))

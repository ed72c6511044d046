"""Are these scene files what a scene may say? Their keys and values are checked, and nothing is planned or rendered.

python synth/check.py SCENE...          (needs no Blender)
"""

import sys
from pathlib import Path

HOME = Path(__file__).resolve().parent
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth.leaving import exit_code, leave, own_arguments  # noqa: E402
from synth.spec import read_scene  # noqa: E402


def main() -> None:
    """Raises InputError for the first that is refused."""
    for scene in own_arguments():
        read_scene(Path(scene))


if __name__ == "__main__":
    leave(exit_code(main, ""))

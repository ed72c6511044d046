"""The end of a program that may have loaded Blender."""

import os
import sys
from typing import NoReturn


def leave(code: int) -> NoReturn:
    """End the process with `code`, without Blender's temporary folder left behind."""
    if "bpy" in sys.modules:
        from synth.blender.session import remove_temporary_folder

        remove_temporary_folder()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # bpy 4.5 hangs in the interpreter's regular exit

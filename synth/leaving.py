"""How the programs of this folder end: exit codes, one sentence on what went wrong, and leaving Blender."""

import os
import sys
import traceback
from collections.abc import Callable
from typing import NoReturn

from synth.errors import InputError


def exit_code(command: Callable[[], None], interrupted: str, failed: str = "") -> int:
    """Run a command line: 0 done, 1 a defect of ours, 2 bad input, 130 interrupted.

    Args:
        interrupted: what is said after Ctrl-C.
        failed: what is added to the reason when the system refuses something, a full disk for instance.
    """
    try:
        command()
    except SystemExit as stop:  # argparse: --help or a usage error
        return int(stop.code or 0)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{error.filename or 'The output'}: {error.strerror}{failed}.", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nInterrupted{interrupted}.", file=sys.stderr)
        return 130
    except Exception:  # not further: bpy 4.5 hangs in the interpreter's regular exit
        traceback.print_exc()
        return 1
    return 0


def own_arguments() -> list[str]:
    """The command line without Blender's part, which ends at "--"."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return sys.argv[1:] if "bpy" not in sys.modules else []


def leave(code: int) -> NoReturn:
    """End the process with `code`, without Blender's temporary folder left behind."""
    if "bpy" in sys.modules:
        from synth.blender.session import remove_temporary_folder

        remove_temporary_folder()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # bpy 4.5 hangs in the interpreter's regular exit

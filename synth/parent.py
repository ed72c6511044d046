"""A process that ends with the one that started it, however that one ends."""

import os
import signal
import sys
import threading
import time

PARENT = "AA4D_PARENT"  # environment: the process id of the starter, for whom alone this one works
LOOK_EVERY_S = 0.5


def end_with_parent(environment: "os._Environ[str] | dict[str, str]" = os.environ) -> None:
    """End this process, at once, when the starter that is named in the environment has ended; without one do nothing.

    Files are written whole or not at all, so that nothing is lost but what is being made. On Linux the kernel does it
    (PR_SET_PDEATHSIG), elsewhere, or where another process stands between, a thread looks.
    """
    starter = environment.pop(PARENT, "")  # not for the processes that this one starts
    if not starter.isdigit():
        return
    if sys.platform == "linux" and os.getppid() == int(starter) and _ask_the_kernel():
        if os.getppid() != int(starter):  # it ended in between
            os._exit(1)
        return
    threading.Thread(target=_watch, args=(int(starter),), daemon=True).start()


def environment_of_child() -> dict[str, str]:
    """The environment for a child that shall end with this process."""
    return {**os.environ, PARENT: str(os.getpid())}


def _ask_the_kernel() -> bool:
    import ctypes

    try:
        return ctypes.CDLL(None, use_errno=True).prctl(1, signal.SIGKILL, 0, 0, 0) == 0  # 1: PR_SET_PDEATHSIG
    except (OSError, AttributeError):
        return False


def _watch(starter: int) -> None:
    while _lives(starter):
        time.sleep(LOOK_EVERY_S)
    os._exit(1)


def _lives(process: int) -> bool:
    if sys.platform == "win32":
        import ctypes

        handle = ctypes.windll.kernel32.OpenProcess(0x00100000, False, process)  # SYNCHRONIZE
        if not handle:
            return False
        ended = ctypes.windll.kernel32.WaitForSingleObject(handle, 0) == 0
        ctypes.windll.kernel32.CloseHandle(handle)
        return not ended
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it lives, as somebody else's
        return True
    return True

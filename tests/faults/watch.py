"""Every file that is opened or was written on a file system, heard of by fanotify: an opening waits for the answer."""

from __future__ import annotations

import ctypes
import os
import re
import select
import struct
from collections.abc import Callable
from pathlib import Path

CONTENT_CLASS, CLOSE_ON_EXEC = 4, 1
OPENING, WRITTEN = 0x10000, 0x8
ADD, FILE_SYSTEM, HERE = 1, 0x100, -100
EVENT, ALLOWED = "=IBBHQii", 1
# What differs between two runs of a command: what is random in the names of temporary files, and what is counted.
RANDOM = re.compile(
    r"(?<=\.)[a-z0-9_]{8}(?=\.part)|(?<=tmp)[a-z0-9_]{8}\b|(?<=tmp/)[a-z0-9_]{8}$"
    r"|(?<=-)[a-z0-9_]{8}(?=/)|(?:(?<=/\.tmp)|(?<=\.part\.))\w{6}$|[0-9a-f]{12,}|\d+"
)


class NoWatch(Exception):  # noqa: N818, where it is so these faults are left out
    """This system lets nobody wait for files to be opened; the message says why."""


def kind_of(name: str) -> str:
    """A file's name without what is random or counted in it: frames of a clip are one kind."""
    return RANDOM.sub("*", name)


class Watch:
    """Hears of files on the file system of `folder`.

    Nothing else may open files there in the process that listens: it would wait for itself.
    """

    def __init__(self, folder: Path) -> None:
        """Raises NoWatch."""
        libc = ctypes.CDLL(None, use_errno=True)
        self.folder = folder
        try:
            self.handle = libc.fanotify_init(CONTENT_CLASS | CLOSE_ON_EXEC, os.O_RDONLY | os.O_LARGEFILE)
        except AttributeError:
            raise NoWatch("this C library has no fanotify") from None
        events = ctypes.c_uint64(OPENING | WRITTEN)
        if self.handle < 0 or libc.fanotify_mark(self.handle, ADD | FILE_SYSTEM, events, HERE, bytes(folder)):
            raise NoWatch(f"fanotify needs root ({os.strerror(ctypes.get_errno())})")

    def close(self) -> None:
        """What waits for an answer goes on."""
        os.close(self.handle)

    def hear(
        self,
        seconds: float,
        opening: Callable[[str, os.stat_result], None],
        written: Callable[[str, os.stat_result], None],
    ) -> None:
        """Tell of each file that is being opened (it is not, until `opening` returns) or was closed after writing.

        Both get the file's kind and what is known of it. Returns once nothing has happened for so many seconds.
        """
        while select.select([self.handle], [], [], seconds)[0]:
            seconds, events = 0.0, os.read(self.handle, 1 << 16)
            while events:
                length, _, _, _, mask, file, _ = struct.unpack_from(EVENT, events)
                events = events[length:]
                try:
                    name = os.path.relpath(os.readlink(f"/proc/self/fd/{file}"), self.folder)
                    told = opening if mask & OPENING else written
                    told(kind_of(name), os.fstat(file))
                finally:
                    if mask & OPENING:
                        os.write(self.handle, struct.pack("=iI", file, ALLOWED))
                    os.close(file)

"""A small file system of its own, in memory, which this process and its children alone see."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

NEW_USER, NEW_MOUNTS = 0x10000000, 0x00020000
READ_ONLY, REMOUNT, PRIVATE_ALL = 1, 32, (1 << 18) | 16384
ROOMY, MANY = 1 << 30, 1 << 20  # bytes, files
DETACH = 2
PAGE = 4096


class NoDisk(Exception):  # noqa: N818, where it is so the checks are left out
    """This system lets nobody have a file system of his own; the message says why."""


def enter_own_mounts() -> None:
    """From here on this process may mount what it likes: nobody else sees it, and it is gone with the process.

    Raises:
        NoDisk: it may not, or this is no Linux.
    """
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        unshare = libc.unshare
    except (OSError, AttributeError):
        raise NoDisk("file systems of one's own need Linux") from None
    user, group = os.getuid(), os.getgid()
    if unshare(NEW_MOUNTS | (NEW_USER if user else 0)):
        raise NoDisk(f"a file system of one's own needs root or user namespaces ({os.strerror(ctypes.get_errno())})")
    if user:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    _mount("none", "/", None, PRIVATE_ALL, "")


def obey_permissions() -> None:
    """From here on this process and what it starts may write only what its owner may, as everybody who is not root."""
    libc = ctypes.CDLL(None)
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    libc.capget(header, sets)
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP
        for index in (0, 1, 2):  # effective, permitted, inheritable
            sets[index] &= ~(1 << capability)
    libc.capset(header, sets)


class SmallDisk:
    """One that holds so many bytes and so many files, to be changed at any time."""

    def __init__(self, folder: Path) -> None:
        """Raises NoDisk."""
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        _mount("tmpfs", str(folder), "tmpfs", 0, f"size={ROOMY},nr_inodes={MANY}")

    def used(self) -> int:
        """Bytes."""
        found = os.statvfs(self.folder)
        return (found.f_blocks - found.f_bfree) * found.f_frsize

    def files(self) -> int:
        """Files and folders, itself too."""
        found = os.statvfs(self.folder)
        return found.f_files - found.f_ffree

    def hold(self, size: int = ROOMY, files: int = MANY) -> None:
        """Let it hold `size` bytes, rounded up to pages, and `files` files and folders, itself too."""
        pages = max(-(-size // PAGE), 1)  # none would mean any number
        _mount("tmpfs", str(self.folder), "tmpfs", REMOUNT, f"size={pages * PAGE},nr_inodes={files}")

    def hold_more(self, size: int) -> None:
        """Let it hold `size` bytes, whole pages, beside what is there."""
        for attempt in range(100):
            try:
                return self.hold(self.used() + size)
            except NoDisk:  # somebody has written more in this moment
                if attempt == 99:
                    raise

    def protect(self, *, read_only: bool) -> None:
        _mount("tmpfs", str(self.folder), "tmpfs", REMOUNT | (READ_ONLY if read_only else 0), "")

    def remove(self) -> None:
        ctypes.CDLL(None).umount2(str(self.folder).encode(), DETACH)


def _mount(source: str, target: str, kind: str | None, flags: int, options: str) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    encoded = None if kind is None else kind.encode()
    if libc.mount(source.encode(), target.encode(), encoded, ctypes.c_ulong(flags), options.encode()):
        raise NoDisk(f"{target}: cannot be mounted ({os.strerror(ctypes.get_errno())})")

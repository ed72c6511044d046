"""Blender as a process: an empty file, and none of its chatter on standard output."""

import io
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TextIO

import bpy


def version() -> str:
    """As in "4.5.15"."""
    return ".".join(str(number) for number in bpy.app.version)


def start_empty() -> None:
    """An empty file with factory settings: nothing of the user's start-up file reaches the render."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def remove_temporary_folder() -> None:
    """Delete Blender's own folder for temporary files, which only its regular exit would."""
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)


def silence() -> TextIO:
    """Send what Blender prints to nowhere; returns the real standard output, which `sys.stdout` becomes too."""
    sys.stdout.flush()
    ours = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    sys.stdout = ours
    return ours


@contextmanager
def unsaid() -> Iterator[None]:
    """Send what an importer prints, on both streams, to nowhere: the caller tells what is raised."""
    sys.stderr.flush()
    ours, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        sys.stderr.flush()
        os.dup2(ours, 2)
        os.close(ours)
        os.close(nowhere)

"""Blender as a process: an empty file, and none of its chatter on standard output."""

import os
import shutil
import sys
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

"""Scenes that the renderer would refuse are refused before an experiment begins; only synth/ understands them."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from aa4d.blender import run_forwarding_interrupts, script
from aa4d.errors import InputError, Interrupted
from aa4d.experiments.kinds.render import Rendering
from aa4d.graph.child import INTERRUPTED
from aa4d.graph.store import Store
from aa4d.graph.task import Task


def check_scenes(experiment: Path, tasks: Iterable[Task], store: Store) -> None:
    """Check the keys and values of every scene that is still to be rendered, as the experiment changes them.

    Raises:
        InputError: the first that is refused, with the key and what would be allowed.
    """
    to_render = [task for task in tasks if task.kind == "render" and store.kept(task, {}) is None]
    renderings: list[Rendering] = [task.settings for task in to_render]
    if not renderings:
        return
    said: list[str] = []
    with ExitStack() as stack:
        files = {str(stack.enter_context(rendering.file())): rendering for rendering in renderings}
        code = run_forwarding_interrupts([sys.executable, str(script("synth/check.py")), *files], said.append)
    if code in INTERRUPTED:
        raise Interrupted("")
    if code != 0:
        sentence = next((line for line in reversed(said) if line), f"checking its scenes ended with exit code {code}")
        for file, rendering in files.items():  # a derived one is gone by now
            sentence = sentence.replace(file, rendering.described)
        raise InputError(f"{experiment}: {sentence}")

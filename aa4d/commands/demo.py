"""`aa4d demo`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.console import console, stage_listener


def demo(
    scene: Annotated[Positional[Path], arg(help="Scene file.")] = Path("scenes/crossroads.toml"),
    out: Annotated[Path, arg(help="Folder for everything the demo makes.")] = Path("demo"),
) -> None:
    """The main job: render a scene, train, evaluate, show the result in Blender. Continues where it stopped."""
    from aa4d.demo import run_demo
    from aa4d.methods.adaanchor4d.settings import PRESETS
    from aa4d.methods.settings import MotionSettings

    with stage_listener() as tell:
        run_demo(scene, out, replace(PRESETS["quick"], motion=MotionSettings()), console, tell)

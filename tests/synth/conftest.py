"""One tiny capture, rendered once through the command line, for all tests that look at what a render wrote."""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from synth.export import FORMATS  # noqa: E402
from synth.truth import PASSES  # noqa: E402

Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def tiny_scene() -> Path:
    return ROOT / "scenes" / "tiny.toml"


@pytest.fixture(scope="session")
def flyover() -> Command:
    """Runs `python synth/render_flyover.py ...` from another folder than the repository's."""

    def run(arguments: Sequence[object]) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, str(ROOT / "synth" / "render_flyover.py"), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=240, cwd=ROOT.parent, check=False)

    return run


@pytest.fixture(scope="session")
def capture(tmp_path_factory: pytest.TempPathFactory, flyover: Command, tiny_scene: Path) -> Path:
    """The finished capture of the tiny scene."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("needs the bpy module")
    out = tmp_path_factory.mktemp("captures") / "tiny"
    result = flyover([tiny_scene, "--out", out])
    assert result.returncode == 0, result.stderr
    assert "capture.json" in result.stdout
    assert "Fra:" not in result.stdout, "Blender's own chatter reached standard output"
    return out


@pytest.fixture(scope="session")
def full_capture(tmp_path_factory: pytest.TempPathFactory, flyover: Command, tiny_scene: Path) -> Path:
    """The tiny scene with every pass and every export, by two workers."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("needs the bpy module")
    folder = tmp_path_factory.mktemp("full")
    scene = folder / "full.toml"
    exports, passes = json.dumps(list(FORMATS)), json.dumps(list(PASSES))
    scene.write_text(f"exports = {exports}\n{tiny_scene.read_text()}\n[truth]\npasses = {passes}\n")
    result = flyover([scene, "--out", folder / "capture", "--workers", "2"])
    assert result.returncode == 0, result.stderr
    return folder / "capture"

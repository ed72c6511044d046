"""The main job, whole and small: a scene file becomes a report and a .blend, with real Blender at both ends."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from aa4d import demo_stages
from aa4d.demo import run_demo
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings

SCENE = Path(__file__).parent.parent / "scenes/crossroads.toml"
MOTION = MotionSettings(clean_iterations=10)
CONFIG = AdaAnchor4DSettings(preset="test", coarse_iterations=20, fine_iterations=20, motion=MOTION)

pytestmark = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="the bpy module is not installed")


def silent(*_: object) -> None:
    pass


def small_scene(folder: Path) -> Path:
    """The crossroads at 96x54, 9 frames, 2 samples, with truth of activity."""
    text = SCENE.read_text() + '\n[truth]\npasses = ["activity"]\n'
    for key, value in (("frames", 9), ("width_px", 96), ("height_px", 54), ("samples", 2)):
        text, replaced = re.subn(rf"^{key} = \d+", f"{key} = {value}", text, flags=re.MULTILINE)
        assert replaced == 1, key
    path = folder / "small.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("main job")  # a space in the path, as users have them
    scene = small_scene(folder)
    run_demo(scene, folder / "demo", CONFIG, Console(quiet=True), silent)
    return scene, folder / "demo"


def test_every_result_is_there(finished: tuple[Path, Path]) -> None:
    _, out = finished
    summary = json.loads((out / "summary.json").read_text())
    wanted = {"psnr", "psnr_dynamic", "ssim", "fps", "anchors", "gaussians", "neural_mib", "seconds"}
    assert wanted <= summary.keys()
    assert list(summary["seconds"]) == [
        "synthesis",
        "training",
        "paper",
        "evaluation",
        "page",
        "extension",
        "blend",
        "report",
    ]
    assert all(seconds > 0 for seconds in summary["seconds"].values())
    assert json.loads((out / "metrics.json").read_text())["psnr"] == summary["psnr"]
    assert (out / "report.html").read_text().count("data:image/png") >= 5
    assert summary["paper"].keys() == {"psnr", "psnr_dynamic", "ssim", "fps"}
    assert "the paper&#39;s model" in (out / "report.html").read_text()
    picture = np.asarray(Image.open(out / "flyover.png").convert("RGB"))
    assert picture.std() > 10


def test_every_score_that_truth_allows_is_measured(finished: tuple[Path, Path]) -> None:
    """What a renderer writes and what an evaluation reads are made apart: a score may quietly find no pixel."""
    metrics = json.loads((finished[1] / "metrics.json").read_text())
    by_truth = {
        "psnr_dynamic",
        "psnr_still",
        "psnr_swept",
        "motion_epe_px",
        "travel_ratio",
        "activity_rank_correlation",
    }
    assert {key for key in by_truth if metrics[key] is None} == set()
    assert sum(metrics["activity_share"].values()) == pytest.approx(1)


def test_the_blend_file_opens_on_animated_anchors_without_the_extension(finished: tuple[Path, Path]) -> None:
    """A fresh Blender, factory settings: the anchors move because their motion is baked into the file."""
    _, out = finished
    code = f"""
import os, bpy, numpy as np
bpy.ops.wm.open_mainfile(filepath={str(out / "flyover.blend")!r})
scene = bpy.context.scene
anchors = next(o for o in scene.objects if o.type == "MESH" and not o.hide_viewport)
def positions(frame):
    scene.frame_set(frame)
    geometry = anchors.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    values = np.empty(3 * len(cloud.points), np.float32)
    cloud.attributes["position"].data.foreach_get("vector", values)
    return values.reshape(-1, 3)
first, last = positions(scene.frame_start), positions(scene.frame_end)
print("RESULT", len(anchors.data.vertices), scene.frame_end, scene.render.fps, scene.camera.animation_data is not None,
      float(np.abs(first[: len(last)] - last[: len(first)]).max()) > 0, flush=True)
os._exit(0)
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    result = next(line for line in ran.stdout.splitlines() if line.startswith("RESULT")).split()[1:]
    summary = json.loads((out / "summary.json").read_text())
    assert int(result[0]) >= summary["anchors"]
    assert result[1:] == ["9", "12", "True", "True"]


def test_running_it_again_repeats_nothing(finished: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    scene, out = finished
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}

    def never(*_: object) -> int:
        raise AssertionError("nothing is left to do")

    for name in ("run_in_blender", "run_forwarding_interrupts", "fit", "evaluate", "write_report"):
        monkeypatch.setattr(demo_stages, name, never)
    run_demo(scene, out, CONFIG, Console(quiet=True), silent)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()} == before

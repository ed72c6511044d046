"""Renders at the edges: one frame, nobody, cars of two pixels, 40,000 objects, a hovering drone, odd frame rates."""

import importlib.util
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from synth.develop import read_png
from synth.truth.recording import Recording
from synth.verify import verify

Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]
ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
PASSES = '\n[truth]\npasses = ["flow", "occlusion", "visible_pixels", "boxes", "activity"]\n'


def render(flyover: Command, tiny_scene: Path, folder: Path, more: str = "", **values: object) -> Recording:
    """The tiny scene with some of its numbers changed, rendered and checked."""
    text = tiny_scene.read_text()
    for key, value in values.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert count >= 1, key
    scene = folder / "scene.toml"
    scene.write_text(text + more + PASSES)
    result = flyover([scene, "--out", folder / "capture"])
    assert result.returncode == 0, result.stderr
    assert [row.check for row in verify(folder / "capture") if not row.passes] == []
    return Recording(folder / "capture")


def test_one_frame_has_no_valid_flow(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    recording = render(flyover, tiny_scene, tmp_path, frames=1)
    flow = recording.arrays(0, "flow")
    assert not flow["forward_valid"].any()
    assert not flow["backward_valid"].any()
    assert np.isnan(flow["flow_forward"]).all()
    assert (recording.arrays(0, "occlusion")["forward"] == 3).all()
    assert recording.index["heterogeneity"]["time"] == 0.0
    assert 0.0 < recording.index["heterogeneity"]["space"] < 1.0


def test_hover_at_an_odd_rate(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    """No baseline: nothing that stands moves in the picture; 7.3 frames per second divide no millisecond."""
    recording = render(flyover, tiny_scene, tmp_path, sweep_deg=0.0, fps=7.3, frames=3)
    for k in range(3):
        ids, flow = recording.truth(k)["instance_id"], recording.arrays(k, "flow")
        if k < 2:
            still = ids == 0
            assert np.abs(flow["flow_forward"][still]).max() < 1e-4
            assert (recording.arrays(k, "occlusion")["forward"][still] != 2).all()
            moving = recording.tracks["instance_id"][recording.tracks["moving"][k] & recording.tracks["moving"][k + 1]]
            driving = np.isin(ids, moving)
            assert np.linalg.norm(flow["flow_forward"][driving], axis=-1).max() > 0.5
    pycolmap = pytest.importorskip("pycolmap")
    assert pycolmap.Reconstruction(str(recording.root / "sparse" / "0")).num_images() == 3


def test_cars_of_two_pixels(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    recording = render(flyover, tiny_scene, tmp_path, altitude_m=190.0, frames=2)
    counted = recording.pass_arrays("visible_pixels")
    assert counted is not None
    counts = counted["visible_pixels"]
    assert 0 < np.median(counts[counts > 0]) <= 3
    for k in range(2):
        ids = recording.truth(k)["instance_id"]
        assert counts[k].sum() == (ids > 0).sum()


EFFECTS = """
[effects.gimbal_jitter]
[effects.wind]
[effects.cloud_shadow]
size_m = 30
[effects.wet_road]
[effects.signal_lamps]
[effects.indicator_lights]
[effects.motion_blur]
exposure_s = 0.5
[effects.rolling_shutter]
readout_s = 0.0
[effects.haze]
[effects.sensor_noise]
[effects.burned_in_text]
height_share = 0.2
[effects.video_compression]
[effects.pose_noise]
"""


def test_many_effects_at_once(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    """An exposure of a whole frame, no readout, and everything that can be had together."""
    recording = render(flyover, tiny_scene, tmp_path, EFFECTS, frames=3)
    index = recording.index
    assert index["shutter"] == {"exposure_s": 0.5, "readout_s": 0.0}
    assert "rows" not in index
    assert {i["class"] for i in index["instances"]} >= {"tree", "signal-lamp", "indicator", "car"}
    off = [np.abs(np.array(f["viewmat"]) - np.array(f["viewmat_true"])).max() for f in index["frames"]]
    assert 0.01 < max(off) < 10
    stored = recording.pass_arrays("activity")
    assert stored is not None
    classes = np.array([i["class"] for i in index["instances"]])
    assert set(stored["instance_label"][classes == "tree"]) <= {1, 2}
    assert (stored["cell_label"] == 3).any()  # the clouds
    compressed = (recording.root / "frames" / "000001.png").read_bytes()
    assert compressed != (recording.root / "uncompressed" / "000001.png").read_bytes()
    text = read_png((recording.root / "left_out" / "all.png").read_bytes()) > 0
    developed = read_png((recording.root / "uncompressed" / "000001.png").read_bytes())
    assert 0 < text.mean() < 0.2
    assert np.isin(developed[text], (0, 255)).all()
    cost = json.loads((recording.root / "cost.json").read_text())
    assert {"haze", "sensor_noise", "burned_in_text", "video_compression"} == set(cost["effects"])


def test_lens_distortion_carries_all_passes(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    more = "\n[effects.lens_distortion]\nk1 = -0.2\np1 = 0.002\n"
    recording = render(flyover, tiny_scene, tmp_path, more, frames=3)
    assert recording.index["camera"]["model"] == "OPENCV"
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(str(recording.root / "sparse" / "0"))
    for image in model.images.values():
        for observation in image.points2D[:20]:
            projected = image.project_point(model.points3D[observation.point3D_id].xyz)
            assert np.abs(projected - observation.xy).max() < 2e-3


MANY = """
import os, sys
from dataclasses import replace
from pathlib import Path
import bpy, numpy as np
from synth.blender.film import Filming
from synth.blender.materials import INSTANCE
from synth.blender.passes import truth
from synth.blender.session import silence
from synth.capture import Folder
from synth.costs import Costs
from synth.plan import make_plan
from synth.spec import read_scene
out = silence()
plan = make_plan(read_scene(Path(sys.argv[1])))
filming = Filming(plan, Folder(Path(sys.argv[2])), Costs(None), Path(sys.argv[2]))
mesh = filming.stage.vehicles[0].data
filming.place(plan.frames[0])
rng, first = np.random.default_rng(0), len(plan.fleet.instances) + 1
shown = {}
for number in range(first, 40_001):
    thing = bpy.data.objects.new("x", mesh)
    thing[INSTANCE] = float(number)
    near = number > 39_950
    thing.location = (*rng.uniform(-12, 12, 2), 3.0 + 0.001 * number % 1) if near else (0, 0, -500.0 - number)
    filming.stage.scene.collection.children[0].objects.link(thing)
ids = truth(filming.renderer.render_truth(), plan, plan.frames[0])["instance_id"]
seen = np.unique(ids[ids > 39_950])
print("RESULT", len(seen), seen.max(), ids.max() <= 40_000, file=out, flush=True)
os._exit(0)
"""


@pytest.mark.slow
def test_forty_thousand_objects_keep_their_ids_through_blender(tiny_scene: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", MANY, str(tiny_scene), str(tmp_path)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=280, cwd=ROOT, check=False)
    assert "RESULT" in ran.stdout, ran.stderr
    count, highest, exact = ran.stdout.split("RESULT")[1].split()
    assert int(count) >= 20
    assert 39_990 < int(highest) <= 40_000
    assert exact == "True"


VECTORS = """
import os, sys
from dataclasses import replace
from pathlib import Path
import bpy, numpy as np
from synth.blender.film import Filming
from synth.blender.motion import animate
from synth.blender.passes import truth
from synth.blender.session import silence
from synth.capture import Folder
from synth.costs import Costs
from synth.plan import make_plan
from synth.shutter import Shutter
from synth.spec import read_scene
from synth.truth.derive import view_of
from synth.truth.flow import flow
out = silence()
plan = make_plan(read_scene(Path(sys.argv[1])))
filming = Filming(plan, Folder(Path(sys.argv[2])), Costs(None), Path(sys.argv[2]))
frame = plan.frames[2]
filming.place(frame)
filming.renderer.truth.view_layers[0].use_pass_vector = True
# Keys one frame before and after: the shutter of two whole frames.
fps = plan.scene.time.fps
animate(replace(plan, shutter=Shutter(exposure_s=2 / fps, steps=1)), frame, filming.stage, filming.extras)
passes = filming.renderer.render_truth()
found = truth(passes, plan, frame)
worst = []
for rank, x, y in ((3, -passes["Vector.Z"], passes["Vector.W"]), (1, passes["Vector.X"], -passes["Vector.Y"])):
    ours, valid = flow(view_of(plan, frame), view_of(plan, plan.frames[rank]), found["depth_z"], found["instance_id"])
    for on in (found["instance_id"] == 0, found["instance_id"] > 0):
        off = np.linalg.norm(ours - np.stack([x, y], axis=-1), axis=-1)[valid & on]
        worst.append(np.percentile(off, 99))
print("RESULT", *worst, np.abs(passes["Vector.Z"]).max(), file=out, flush=True)
os._exit(0)
"""


def test_flow_is_that_of_blenders_vector_pass(tiny_scene: Path, tmp_path: Path) -> None:
    """An oracle that shares no code: Cycles' own motion vectors, where nothing appears or goes."""
    command = [sys.executable, "-c", VECTORS, str(tiny_scene), str(tmp_path)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=ROOT, check=False)
    assert "RESULT" in ran.stdout, ran.stderr
    *worst, greatest = map(float, ran.stdout.split("RESULT")[1].split())
    assert greatest > 3
    assert max(worst) < 0.005


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="reads /proc")
def test_memory_stays_flat_over_three_hundred_frames(tiny_scene: Path, tmp_path: Path) -> None:
    text = tiny_scene.read_text()
    for old, new in (("frames = 6", "frames = 300"), ("fps = 2", "fps = 30"), ("width_px = 96", "width_px = 32"),
                     ("height_px = 54", "height_px = 18"), ("samples = 2", "samples = 1")):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "long.toml").write_text(text)
    command = [sys.executable, str(ROOT / "synth" / "render_flyover.py"), str(tmp_path / "long.toml"), "--out",
               str(tmp_path / "out")]  # fmt: skip
    peaks = {False: 0, True: 0}  # kB, in the first hundred frames and after
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (tmp_path / "out" / "frames" / "000299.png").is_file():
        found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text())
        late = (tmp_path / "out" / "frames" / "000100.png").is_file()
        peaks[late] = max(peaks[late], int(found[1]) if found else 0)
        time.sleep(0.1)
    assert process.wait(timeout=120) == 0
    assert 0 < peaks[True] < 1.05 * peaks[False]

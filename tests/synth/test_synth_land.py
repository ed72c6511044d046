"""The land around the scene: where a frame looks so far, to the horizon, and nothing else changes."""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synth.city.land import OUTERMOST_M, land, looks_beyond
from synth.flight.hover import Hover
from synth.plan import Plan, make_plan
from synth.spec import read_scene
from synth.streets.ground import BEYOND_M
from synth.truth.classes import CLASS_OF_SURFACE

ROOT = Path(__file__).resolve().parents[2]


def hovering(tiny_scene: Path, position: tuple[float, float, float], pitch: float) -> Plan:
    scene = read_scene(tiny_scene)
    flight = Hover(position_m=position, yaw_deg=90.0, pitch_deg=pitch)
    return make_plan(replace(scene, flight=flight, time=replace(scene.time, frames=1)))


@pytest.mark.parametrize(
    ("position", "pitch", "beyond"),
    [
        ((0, 0, 120.0), -90.0, False),
        ((0, -60, 120.0), -15.0, True),
        ((0, 0, 120.0), -60.0, False),
        ((0, 0, 1900.0), -90.0, True),
        ((0, 0, 5.0), 10.0, True),
        ((590.0, 0, 120.0), -90.0, True),
        ((900.0, 0, 20.0), -90.0, True),
    ],
)
def test_land_is_there_where_a_frame_looks_beyond(
    tiny_scene: Path, position: tuple[float, float, float], pitch: float, beyond: bool
) -> None:
    plan = hovering(tiny_scene, position, pitch)
    assert bool(plan.city.land.faces) == beyond


def test_a_margin_looks_farther(tiny_scene: Path) -> None:
    """The corners of a picture from straight above, at the altitude where they reach the edge of the ground."""
    plan = hovering(tiny_scene, (0, 0, 100.0), -90.0)
    size, corner = (96.0, 54.0), np.abs(np.linalg.inv(plan.K) @ [0, 0, 1])[:2]
    edge = BEYOND_M / corner.max()
    for altitude, margin, beyond in ((0.9 * edge, 0.0, False), (1.01 * edge, 0.0, True), (0.9 * edge, 10.0, True)):
        viewmats = hovering(tiny_scene, (0, 0, altitude), -90.0).frames[0].viewmat[None]
        assert looks_beyond(viewmats, plan.K, size, (margin, margin)) == beyond


@pytest.mark.parametrize("highest_m", [1.0, 30.0, 1900.0])
def test_land_surrounds_the_ground_without_a_hole(highest_m: float) -> None:
    mesh = land(highest_m, 1e-3)
    corners = np.array(mesh.vertices).reshape(-1, 4, 3)
    assert (corners[..., 2] == 0).all()
    x, y = corners[..., 0], corners[..., 1]
    area = 0.5 * (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    assert (area > 0).all()  # counter-clockwise: they face up
    end = np.abs(corners).max()
    assert area.sum() == pytest.approx((2 * end) ** 2 - (2 * BEYOND_M) ** 2, rel=1e-12)
    assert min(highest_m / 5e-5, OUTERMOST_M) <= end < 2 * OUTERMOST_M
    assert np.arctan(highest_m / end) <= max(5e-5, highest_m / OUTERMOST_M)
    assert set(mesh.surfaces) == {"land"}
    assert CLASS_OF_SURFACE["land"] == "vegetation"


RENDER = """
import os, sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from synth.blender.film import Filming
from synth.blender.passes import linear_rgb, truth
from synth.blender.session import silence
from synth.capture import Folder
from synth.city.mesh import Mesh
from synth.costs import Costs
from synth.flight.hover import Hover
from synth.plan import make_plan
from synth.spec import read_scene
from synth.truth.derive import view_of
out, folder = silence(), Path(sys.argv[2])
scene = read_scene(Path(sys.argv[1]))
flight = Hover(position_m=(0.0, -60.0, float(sys.argv[3])), yaw_deg=70.0, pitch_deg=-15.0)
plan = make_plan(replace(scene, flight=flight, time=replace(scene.time, frames=1)))
shown = []
for each in (plan, replace(plan, city=replace(plan.city, land=Mesh()))):
    filming = Filming(each, Folder(folder), Costs(None), folder)
    filming.place(plan.frames[0])
    depth = truth(filming.renderer.render_truth(), plan, plan.frames[0])["depth_z"]
    shown.append((depth, linear_rgb(filming.renderer.render_picture(1))))
(depth, picture), (before, former) = shown
view = view_of(plan, plan.frames[0])
below = (view.rays() @ view.viewmat[:3, :3])[..., 2] < 0
hit = np.isfinite(before)
near = np.pad(hit, 2, mode="edge")
inside = np.min([near[i : i + hit.shape[0], j : j + hit.shape[1]] for i in range(5) for j in range(5)], axis=0)
rays = view.rays() @ view.viewmat[:3, :3]
new = np.isfinite(depth) & ~hit
exact = float(sys.argv[3]) / -rays[new][:, 2]
print("RESULT", (below & ~hit).mean(), (below & ~np.isfinite(depth)).mean(), np.isfinite(depth[~below]).mean(),
      np.array_equal(depth[hit], before[hit]), np.array_equal(picture[inside], former[inside]), inside.mean(),
      np.median(np.abs(depth[new] / exact - 1)), file=out, flush=True)
os._exit(0)
"""


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
@pytest.mark.parametrize("altitude_m", [120.0, 1900.0])
def test_no_pixel_below_the_horizon_is_empty(tiny_scene: Path, tmp_path: Path, altitude_m: float) -> None:
    command = [sys.executable, "-c", RENDER, str(tiny_scene), str(tmp_path), str(altitude_m)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=ROOT, check=False)
    assert "RESULT" in ran.stdout, ran.stderr
    former, empty, above, same_depth, same_picture, inside, off = ran.stdout.split("RESULT")[1].split()
    assert float(former) > 0.2
    assert float(empty) == 0.0
    assert above == "nan" or float(above) < 0.1  # trees and buildings at most
    assert (same_depth, same_picture) == ("True", "True")
    assert altitude_m > 1000 or float(inside) > 0.3
    assert float(off) < 1e-4

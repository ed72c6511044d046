"""The 4DGS container, read back by its own library."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from aa4d.export import export
from aa4d.export.clip import (
    Clip,
    WorldGaussians,
)
from aa4d.filming.camera_path import path_of_frames, resampled
from aa4d.methods.model_file import LoadedModel
from tests.export.scenes import left_out, riding
from tests.toy_run import silent


def test_4dgs_shows_each_frame_at_its_own_second(toy_run: Path, tmp_path: Path) -> None:
    fourdgs = pytest.importorskip("fourdgs", reason="pip install aa4d[export]")
    loaded = left_out(riding(toy_run))
    clip = Clip(loaded, path_of_frames(loaded, "all"), np.array([0.0, 0, 20]))
    export(clip, "4dgs", tmp_path / "out", silent)
    scene = fourdgs.read(str(tmp_path / "out/scene.4dgs"))
    assert scene.duration_sec == pytest.approx(15 + 15 / 9)
    for index, second in ((0, 0.0), (4, 4.0), (5, 10.0), (8, 12.5)):
        away, _ = KDTree(scene.state_at(second + 1e-4)["centers"]).query(clip.gaussians(index).means)
        assert away.max() < 0.2  # what rides moves 12 / 9 m from one frame to the next


def test_4dgs_holds_every_view_and_moves_between_them(loaded: LoadedModel, tmp_path: Path) -> None:
    fourdgs = pytest.importorskip("fourdgs", reason="pip install aa4d[export]")
    clip = Clip(loaded, resampled(path_of_frames(loaded, "all"), 4), np.array([0.0, 0, 20]))
    export(clip, "4dgs", tmp_path / "out", silent)
    path = tmp_path / "out/scene.4dgs"
    checked = subprocess.run([sys.executable, "-m", "fourdgs.cli", "validate", str(path)], capture_output=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    # Its own converters place it without being told its axes.
    for command, name in (("to-usd", "one.usda"), ("to-gltf", "one.glb")):
        arguments = [sys.executable, "-m", "fourdgs.cli", command, str(path), "-o", str(tmp_path / name)]
        converted = subprocess.run(arguments, capture_output=True, text=True, timeout=120)
        assert converted.returncode == 0, converted.stderr
        assert (tmp_path / name).stat().st_size > 1000
    scene = fourdgs.read(str(path))
    assert scene.duration_sec == pytest.approx(clip.seconds(4))
    assert scene.provenance.frame.metres_per_unit == 1
    identity = json.loads((tmp_path / "out/export.json").read_text())["identity"]
    assert json.loads(scene.header.attributes["aa4d"]) == identity
    bounds = scene.quantization.bounds
    slack = 1e-3 + float(bounds["pos"]) + float(bounds["motion"]) * clip.seconds(1)
    for index in range(4):
        g = clip.gaussians(index)
        # Just after the view's instant; the file keeps times in float32.
        state = scene.state_at(clip.seconds(index) + 1e-4)
        assert len(state["centers"]) == len(g.ids)
        away, _ = KDTree(state["centers"]).query(g.means)
        assert away.max() < np.sqrt(3) * slack
        assert state["opacity"].mean() == pytest.approx(g.opacities.mean(), abs=float(bounds["alpha"]))


def test_between_two_views_a_gaussian_moves_straight_and_a_vanishing_one_stays() -> None:
    slots = pytest.importorskip("aa4d.export.fourdgs_container", reason="pip install aa4d[export]")

    def at(ids: list[int], x: list[float]) -> WorldGaussians:
        n = len(ids)
        means = np.stack([np.array(x), np.zeros(n), np.zeros(n)], axis=1)
        turned_ = np.tile([0.5, 0.1, 0.2, 0.3], (n, 1))
        return WorldGaussians(np.array(ids), means, turned_, np.ones((n, 3)), np.full(n, 0.5), np.full((n, 3), 0.2))

    slot = slots._slot(at([3, 7, 9], [0.0, 5.0, 1.0]), at([2, 3, 9], [8.0, 2.0, -1.0]), 1.0, 1.5)
    assert slot["motions"][:, 0].tolist() == [4, 0, -4]  # metres a second
    for t, x in ((1.0, [0, 5, 1]), (1.25, [1, 5, 0]), (1.5, [2, 5, -1])):
        assert (slot["positions"] + slot["motions"] * (t - slot["mu_t"])[:, None])[:, 0].tolist() == x
    assert (slot["win_lo"] == 1).all()
    assert (slot["win_hi"] == 1.5).all()
    assert slot["rotations"][0].tolist() == [0.1, 0.2, 0.3, 0.5]  # x y z w

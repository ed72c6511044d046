"""Each entry of METHODS trains, survives kill -9 to the same bits, is read back, scored, drawn and exported."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from plyfile import PlyData

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.export import EXPORTERS, export
from aa4d.export.clip import Clip, mean_eye
from aa4d.filming.camera_path import path_of_frames
from aa4d.filming.film import film
from aa4d.methods import DEFAULT, METHODS, method_of
from aa4d.methods.model_file import load_model, read_tensors
from aa4d.methods.settings import RunSettings, with_iterations
from aa4d.training.trainer import train
from aa4d.viewer.cameras import Eye
from aa4d.viewer.following import Followed
from aa4d.viewer.pictures import LAYER_NAMES, Painter, Wanted
from tests.toy_capture import write_toy_capture

ROOT = Path(__file__).parents[2]
KILL = """
import os, signal, sys
from pathlib import Path
from aa4d.capture.reader import read_capture
from aa4d.training.trainer import train
from tests.methods.test_every_method import short
import torch
torch.set_num_threads(1)
done = []
def progress(*_):
    done.append(1)
    if len(done) == 24 + 21:
        os.kill(os.getpid(), signal.SIGKILL)
train(read_capture(Path(sys.argv[1])), Path(sys.argv[2]), short(sys.argv[3]), progress)
"""


def silent(*_: object) -> None:
    pass


def short(name: str) -> RunSettings:
    """A few iterations in which units come and go."""
    settings = with_iterations(method_of(name).presets["quick"], 24, 30)
    schedule = replace(settings.densification, statistics_from=2, start=5, interval=5, until=25)
    return replace(settings, densification=schedule, checkpoint_every=8)


@pytest.fixture(scope="module", params=METHODS)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of each method, beside its capture."""
    folder = tmp_path_factory.mktemp(request.param)
    capture = write_toy_capture(folder / "capture")
    train(read_capture(capture), folder / request.param, short(request.param), silent)
    return folder / request.param


def test_it_learns_and_is_scored(run: Path) -> None:
    metrics = evaluate(run, None, silent)
    assert metrics.psnr > 12
    assert metrics.anchors == len(load_model(run / "model.safetensors").model)
    assert 0 < metrics.neural_mib < metrics.total_mib
    history = (run / "history.csv").read_text().splitlines()
    losses = [float(line.split(",")[3]) for line in history[1:]]
    assert losses[-1] < losses[0]


def test_killed_and_continued_it_ends_in_the_same_bits(run: Path, tmp_path: Path) -> None:
    capture = run.parent / "capture"
    command = [sys.executable, "-c", KILL, str(capture), str(tmp_path / "run"), run.name]
    killed = subprocess.run(command, cwd=ROOT, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=False)
    assert killed.returncode == -signal.SIGKILL
    train(read_capture(capture), tmp_path / "run", short(run.name), silent)
    for file in ("coarse.safetensors", "model.safetensors"):
        whole, parts = read_tensors(run / file)[1], read_tensors(tmp_path / "run" / file)[1]
        assert whole.keys() == parts.keys()
        for name, value in whole.items():
            assert torch.equal(value, parts[name]), name


def test_its_file_says_what_it_is(run: Path) -> None:
    loaded, static = load_model(run / "model.safetensors"), load_model(run / "coarse.safetensors")
    assert loaded.method == run.name == read_tensors(run / "model.safetensors")[0]["method"]
    assert not loaded.is_static
    assert static.is_static
    with torch.no_grad():
        moved = loaded.model.centers(0.8) - loaded.model.centers(0.1)
    assert moved.shape == (len(loaded.model), 3)
    assert moved.abs().max() > 0


def test_units_have_a_row_in_every_tensor_that_is_named(run: Path) -> None:
    model = load_model(run / "model.safetensors").model
    state = model.state_dict()
    assert set(model.unit_tensors()) <= state.keys()
    assert {len(state[name]) for name in model.unit_tensors()} == {len(model)}
    shared = sum(value.numel() for value in model.shared_tensors())
    assert shared + sum(state[name].numel() for name in model.unit_tensors()) == sum(v.numel() for v in state.values())


def test_another_method_does_not_continue_its_run(run: Path) -> None:
    other = next(name for name in (*METHODS, "none") if name != run.name)
    with pytest.raises(InputError, match=rf"{run.name}: holds a run with another method"):
        train(read_capture(run.parent / "capture"), run, short(other), silent)


def test_it_is_filmed_with_every_layer_that_asks_for_nothing_more(run: Path, tmp_path: Path) -> None:
    loaded = load_model(run / "model.safetensors")
    path, layers = path_of_frames(loaded, "held-out"), ["color", "depth", "motion", "speed"]
    film(loaded, path, layers, tmp_path, video=False, progress=silent)
    assert len(list((tmp_path / "motion").glob("*.png"))) == 2


def test_it_is_shown_by_the_viewer_with_every_layer_that_it_has(run: Path) -> None:
    shown = Followed(run, None).load()
    frame = shown.loaded.frames[2]
    for layer in LAYER_NAMES:
        wanted = Wanted(Eye(frame.viewmat, 0.7), 1.5, frame.time_s, layer, ribbons=True)
        picture = Painter().picture((shown,), wanted, 36, 24)
        assert picture.pixels.std() > 0
        assert bool(picture.notes) == (layer in shown.lacking)
    assert {name for name in shown.lacking if not name.startswith("weight-")} <= {"activity", "movers"}
    assert len(shown.ribbons) > 0


def test_it_is_exported_in_every_format(run: Path, tmp_path: Path) -> None:
    loaded = load_model(run / "model.safetensors")
    path = path_of_frames(loaded, "held-out")
    for name, exporter in EXPORTERS.items():
        eye = mean_eye(path) if exporter.states_axes else None
        export(Clip(loaded, path, eye), name, tmp_path / name, silent)
    files = sorted((tmp_path / "ply").glob("*.ply"))
    vertices = PlyData.read(str(files[0]))["vertex"]
    assert 0 < len(vertices) <= len(loaded.model) * loaded.model.per_unit
    assert np.isfinite(vertices["x"]).all()


def test_what_stands_still_is_exported_too(run: Path, tmp_path: Path) -> None:
    loaded = load_model(run / "coarse.safetensors")
    # From one place, since opacities may depend on the direction of view.
    export(Clip(loaded, path_of_frames(loaded, "held-out"), np.array([0.0, 0.0, 10.0])), "ply", tmp_path, silent)
    first, last = (PlyData.read(str(path))["vertex"]["x"] for path in sorted(tmp_path.glob("*.ply")))
    assert len(first)
    assert np.array_equal(first, last)


def test_no_file_outside_of_the_methods_knows_one() -> None:
    """But for what is AdaAnchor4D's own: the paper's ablations, the default of commands, a long run, costs."""
    own = ("experiments/", "commands/", "stress/", "cost/")
    for path in (ROOT / "aa4d").rglob("*.py"):
        where = path.relative_to(ROOT / "aa4d").as_posix()
        for name in METHODS:
            if not where.startswith("methods/") and not (name == DEFAULT and where.startswith(own)):
                assert f"aa4d.methods.{name}" not in path.read_text(), where

"""The demo's bookkeeping, without Blender: stages, their seconds, the summary and the report."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from aa4d.blender import run_forwarding_interrupts
from aa4d.capture.reader import read_capture
from aa4d.demo import Record, Stage, check, summarise
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.evaluate import evaluate
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.reports.demo_report import spread, write_report
from aa4d.scene_files import files_named_in
from aa4d.training.trainer import train


def silent(*_: object) -> None:
    pass


def stage_of(folder: Path, run: Callable[[], None] = silent) -> Stage:
    (folder / "in").write_text("a")
    (folder / "out").write_text("b")
    return Stage("render", "", (folder / "in",), (folder / "out",), run)


def test_a_stage_is_done_while_its_outputs_exist_and_its_inputs_are_the_same(tmp_path: Path) -> None:
    stage, record = stage_of(tmp_path), Record(tmp_path / "seconds.json")
    assert not stage.is_done(record)
    with record.running(stage):
        pass
    assert stage.is_done(Record(tmp_path / "seconds.json"))
    (tmp_path / "in").write_text("a")  # newer, and the same
    assert stage.is_done(record)
    (tmp_path / "in").write_text("c")
    assert not stage.is_done(record)
    (tmp_path / "in").write_text("a")
    (tmp_path / "out").unlink()
    assert not stage.is_done(record)


def test_a_stage_is_done_for_its_settings_its_capture_and_its_own_outputs(toy_capture: Path, tmp_path: Path) -> None:
    (tmp_path / "model").write_text("trained")
    stage = Stage("training", "", (toy_capture,), (tmp_path / "model",), silent, {"seed": 0})
    record = Record(tmp_path / "seconds.json")
    with record.running(stage):
        pass
    assert stage.is_done(record)
    assert not replace(stage, settings={"seed": 1}).is_done(record)
    (tmp_path / "model").write_text("of another day")
    assert not stage.is_done(record)
    (tmp_path / "model").write_text("trained")
    before = (toy_capture / "capture.json").read_bytes()
    shutil.copyfile(toy_capture / "frames/000004.png", toy_capture / "frames/000003.png")
    assert (toy_capture / "capture.json").read_bytes() == before
    assert not stage.is_done(record)


def test_files_that_a_scene_names_are_inputs(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "x"\n[tracks]\nfile = "t.csv"\n[[assets]]\nfile = "a/van.glb"\n[[assets]]\nfile = "no.glb"\n'
    )
    (tmp_path / "a").mkdir()
    for name in ("t.csv", "a/van.glb"):
        (tmp_path / name).touch()
    assert files_named_in(scene) == (tmp_path / "a/van.glb", tmp_path / "t.csv")
    scene.write_text("name = ")
    assert files_named_in(scene) == ()


def test_seconds_of_a_stopped_stage_add_up_and_those_of_a_new_run_begin_anew(tmp_path: Path) -> None:
    path, stage = tmp_path / "seconds.json", stage_of(tmp_path)

    def stopped() -> None:
        with Record(path).running(stage):
            time.sleep(0.02)
            raise Interrupted

    with pytest.raises(Interrupted):
        stopped()
    record = Record(path)
    assert record.seconds == {}
    with record.running(stage):
        time.sleep(0.02)
    assert record.seconds["render"] >= 0.04
    looked_at = Record(path)
    with looked_at.running(stage):
        pass
    assert looked_at.seconds == record.seconds
    anew = Record(path)
    with anew.running(stage):
        (tmp_path / "out").write_text("made anew")
    assert anew.seconds["render"] < record.seconds["render"]


@pytest.mark.parametrize("content", ["", "{}", "[]", '{"done": 3, "stopped": 4}', '{"done": {"x": '])
def test_a_damaged_record_costs_only_the_seconds(tmp_path: Path, content: str) -> None:
    (tmp_path / "seconds.json").write_text(content)
    record = Record(tmp_path / "seconds.json")
    assert record.seconds == {}
    assert not stage_of(tmp_path).is_done(record)


def test_exit_codes_of_stages_are_passed_on() -> None:
    check(0)
    for code in (2, 130):
        with pytest.raises(SystemExit) as stop:
            check(code)
        assert stop.value.code == code
    with pytest.raises(InputError, match="exit code -11"):
        check(-11)


def test_an_interrupt_reaches_the_child_once_and_its_exit_code_comes_back(tmp_path: Path) -> None:
    child = tmp_path / "child.py"
    child.write_text(
        "import sys, time\n"
        "try:\n    print('ready', flush=True); time.sleep(30)\n"
        "except KeyboardInterrupt:\n    time.sleep(0.5); print('saved', flush=True); sys.exit(130)\n"
    )
    code = (
        f"import sys; from aa4d.blender import *; sys.exit(run_forwarding_interrupts([sys.executable, {str(child)!r}]))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "ready\n"
    parent.send_signal(signal.SIGINT)
    assert parent.stdout.read() == "saved\n"
    assert parent.wait(timeout=20) == 130


def test_a_child_that_succeeds_returns_zero() -> None:
    assert run_forwarding_interrupts([sys.executable, "-c", ""]) == 0


def test_spread_prefers_frames_in_which_something_moves() -> None:
    frames = [{"frame": i, "moving_share": 0.0 if i < 3 else 0.1} for i in range(8)]
    assert [f["frame"] for f in spread(frames, 3)] == [4, 5, 6]
    still = [{"frame": i, "moving_share": None} for i in range(2)]
    assert len(spread(still, 3)) == 2


def test_report_holds_its_pictures_and_figures(toy_capture: Path, tmp_path: Path) -> None:
    config = AdaAnchor4DSettings(preset="test", coarse_iterations=5, fine_iterations=5)
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "run", config, silent)
    metrics = evaluate(tmp_path / "run", None, silent).as_json()
    Image.new("RGB", (8, 8)).save(tmp_path / "blender.png")
    named = replace(capture, name="<script>alert(1)</script>")
    report = tmp_path / "report.html"
    write_report(report, named, tmp_path / "run", metrics, {"training": 1.5}, tmp_path / "blender.png")
    html = report.read_text()
    assert "the paper's model" not in html
    sources = re.findall(r'src="([^"]*)', html)
    assert len(sources) >= 5 * 2 + 1
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not re.findall(r'(?:href|src)="https?:', html)
    assert "<script>" not in html
    assert f"{metrics['psnr']:.2f} dB" in html
    compared = tmp_path / "compared.html"
    seconds = {"training": 1.5}
    write_report(compared, named, tmp_path / "run", metrics, seconds, tmp_path / "blender.png", paper=tmp_path / "run")
    assert "the paper&#39;s model" in compared.read_text() or "the paper's model" in compared.read_text()
    assert compared.read_text().count("data:image/png") > len(sources)
    summary = summarise(metrics, {"training": 1.54})
    wanted = {"psnr", "psnr_dynamic", "ssim", "fps", "anchors", "gaussians", "neural_mib", "seconds"}
    assert wanted <= summary.keys()
    assert summary["seconds"] == {"training": 1.5}
    json.dumps(summary, allow_nan=False)

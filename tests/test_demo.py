"""The demo's stages, without Blender: what is done again and what is said; the summary and the report."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from rich.console import Console

from aa4d.blender import run_forwarding_interrupts
from aa4d.capture.reader import read_capture
from aa4d.console import stage_listener
from aa4d.demo import run_demo, summarise
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.evaluate import evaluate
from aa4d.files import claimed
from aa4d.graph.call import Call
from aa4d.graph.child import run_child
from aa4d.graph.events import Advanced, Event, Finished, Said
from aa4d.graph.kinds import Kind, kind_of
from aa4d.graph.task import Task, canonical
from aa4d.identity import digest_of, digest_of_file
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings
from aa4d.reports.demo_report import spread, write_report
from aa4d.scene_files import files_named_in
from aa4d.training.trainer import train


def silent(*_: object) -> None:
    pass


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Instead of the stages: their outputs, whose text is what the settings and the outputs before say. Names of what
    was done."""
    names: list[str] = []

    def run(call: Call) -> dict[str, Any]:
        names.append(call.task.name)
        before = (call.folder / output for need in call.needs for output in need.task.outputs)
        said = digest_of([canonical(call.task.settings), [digest_of_file(path) for path in before if path.is_file()]])
        for output in call.task.outputs:
            path = call.folder / output if "." in output else call.folder / output / "file"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(METRICS | {"fps": said}))
        (call.folder / "paper").mkdir(exist_ok=True)
        (call.folder / "paper/metrics.json").write_text(json.dumps(METRICS))
        return {}

    monkeypatch.setattr("aa4d.demo_stages.KIND", Kind(run))
    return names


METRICS = dict.fromkeys(
    ("psnr", "psnr_dynamic", "psnr_dynamic_static", "ssim", "fps", "anchors", "gaussians", "neural_mib"), 1.0
)
STAGES = ["synthesis", "training", "paper", "evaluation", "page", "extension", "blend", "report"]
CONFIG = AdaAnchor4DSettings(preset="test", coarse_iterations=5, fine_iterations=5, motion=MotionSettings())


def demo(out: Path, config: AdaAnchor4DSettings = CONFIG) -> list[Event]:
    (scene := out.parent / "scene.toml").touch()
    events: list[Event] = []
    run_demo(scene, out, config, Console(quiet=True), events.append)
    return events


def test_a_stage_is_done_again_where_what_it_is_made_from_has_changed(done: list[str], tmp_path: Path) -> None:
    out = tmp_path / "demo"
    demo(out)
    assert done == STAGES
    assert {p.name for p in out.iterdir() if not p.name.startswith(".")} == {
        *("capture", "paper", "model.safetensors", "metrics.json", "page", "adaanchor4d.zip", "flyover.blend"),
        *("flyover.png", "report.html", "summary.json"),
    }
    assert list(json.loads((out / "summary.json").read_text())["seconds"]) == STAGES
    done.clear()
    assert all(isinstance(event, Finished) and event.before for event in demo(out))
    assert done == []
    demo(out, replace(CONFIG, seed=1))
    assert done == ["training", "paper", "evaluation", "page", "blend", "report"]
    done.clear()
    (tmp_path / "scene.toml").write_text("a = 1")
    demo(out, replace(CONFIG, seed=1))
    assert "extension" not in done
    assert done[0] == "synthesis"
    done.clear()
    demo(out, replace(CONFIG, seed=1, motion=None))
    assert "paper" not in done
    assert not json.loads((out / "summary.json").read_text()).get("paper")


@pytest.mark.parametrize("what", ["model.safetensors", "capture/file", "page/scene.html", "adaanchor4d.zip"])
def test_a_result_that_was_edited_by_hand_is_made_again_and_said(what: str, done: list[str], tmp_path: Path) -> None:
    out = tmp_path / "demo"
    demo(out)
    done.clear()
    before = (out / what).read_text()
    (out / what).write_text("of another day")
    said = [event.text for event in demo(out) if isinstance(event, Said)]
    assert len(said) == len(done) == 1, "what comes out as before repeats nothing"
    assert said == [f"{out / what} is not as it was made; demo {done[0]} is made again"]
    assert (out / what).read_text() == before


def test_the_first_stage_that_fails_is_the_sentence(
    done: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(call: Call) -> dict[str, Any]:
        if call.task.name == "training":
            raise InputError("training met NaN; lower the rates")
        return kind.run(call)

    kind = kind_of("demo")
    monkeypatch.setattr("aa4d.demo_stages.KIND", Kind(run))
    with pytest.raises(InputError, match=r"^training met NaN; lower the rates$"):
        demo(tmp_path / "demo")
    monkeypatch.setattr("aa4d.demo_stages.KIND", kind)
    done.clear()
    demo(tmp_path / "demo")
    assert "synthesis" not in done
    assert "training" in done


def test_two_demos_in_one_folder_and_a_scene_that_is_not_there_are_refused(done: list[str], tmp_path: Path) -> None:
    out = tmp_path / "demo"
    with claimed(out, "making a demo"), pytest.raises(InputError, match="another process is making a demo there"):
        demo(out)
    with pytest.raises(InputError, match=r"no.toml: no such scene file; scenes/ holds some"):
        run_demo(tmp_path / "no.toml", tmp_path / "other", CONFIG, Console(quiet=True), silent)
    assert done == []
    assert not (tmp_path / "other").exists()


@pytest.mark.usefixtures("done")
def test_the_console_tells_of_every_stage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (scene := tmp_path / "[scene].toml").touch()
    for _ in range(2):
        with stage_listener() as tell:
            run_demo(scene, tmp_path / "demo", CONFIG, Console(quiet=True), tell)
    said = capsys.readouterr().out.replace("\n", " ")
    assert "synthesis: Blender renders" in said
    assert "paper: the paper's model, for comparison" in said
    assert "training: done before (0 s)" in said


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


def test_a_child_s_frames_are_progress_and_its_last_line_is_why_it_failed() -> None:
    told: list[Event] = []
    call = Call(Task("demo", "synthesis", {}), Path(), (), {}, told.append)

    def child(code: int, *lines: str) -> Callable[[Callable[[str], None]], int]:
        def run(hear: Callable[[str], None]) -> int:
            for line in lines:
                hear(line)
            return code

        return run

    run_child(call, child(0, "frame 1/4", "frame 2/4 of it", "done"), "rendering")
    assert [(e.done, e.total) for e in told if isinstance(e, Advanced)] == [(1, 4), (2, 4)]
    with pytest.raises(InputError, match=r"^no such key$"):
        run_child(call, child(2, "frame 1/4", "no such key", ""), "rendering")
    with pytest.raises(InputError, match="rendering ended with exit code -11"):
        run_child(call, child(-11), "rendering")
    for code in (130, -signal.SIGTERM):
        with pytest.raises(Interrupted, match="saved"):
            run_child(call, child(code, "saved"), "rendering")


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

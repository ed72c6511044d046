"""The GPU's check without a GPU: every part runs on the CPU, and what goes wrong in one is told and stops no other."""

import json
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import pytest

from tests.device import build, parity
from tests.device.__main__ import PARTS, check, main
from tests.device.asked import Asked
from tests.toy_capture import write_toy_capture


@pytest.fixture(scope="module")
def rehearsal(tmp_path_factory: pytest.TempPathFactory, toy_run: Path) -> dict[str, Any]:
    """What the whole check writes for the toy capture."""
    out = tmp_path_factory.mktemp("device") / "result.json"
    given = ["--device", "cpu", "--tiny", "--budget-s", "3000", "--out", str(out)]
    given += ["--model", str(toy_run / "model.safetensors")]
    assert main([*given, "--capture", str(toy_run.parent / "capture")]) == 0
    result: dict[str, Any] = json.loads(out.read_text())
    return result


def found(rehearsal: dict[str, Any], part: str) -> Any:
    return rehearsal["parts"][part]["found"]


@pytest.mark.slow
def test_every_part_is_done(rehearsal: dict[str, Any]) -> None:
    assert {part: row["status"] for part, row in rehearsal["parts"].items()} == dict.fromkeys(PARTS, "done")
    assert '"raised"' not in json.dumps(rehearsal)


@pytest.mark.slow
def test_native_agrees_with_the_reference_wherever_it_is_asked(rehearsal: dict[str, Any]) -> None:
    rows = found(rehearsal, "parity")
    assert rows["summary"]["unexplained"] == []
    assert rows["summary"]["scenes"] >= 6
    assert all(row["decided"] > 0.5 for row in rows["made_up"].values())
    assert set(rows["made_up"]["1 features"]["maps"]) == {"color", "alpha", "depth", "features"}
    assert set(rows["made_up"]["plain"]["gradients"]) >= {"means", "scales", "viewmat", "screen", "screen_absolute"}
    for row in rows["model"]["frames"].values():
        maps = row["maps"]
        assert max(maps["alpha"], maps["depth"]) < 1e-6
        # The toy is a plane under nadir cameras: many Gaussians have one depth, and which of two comes first is open.
        assert maps["color"] < 1e-3


@pytest.mark.slow
def test_kernels_are_exact_and_counted(rehearsal: dict[str, Any]) -> None:
    rows = found(rehearsal, "kernels")["kernels"]
    assert all(row["exactness"]["within"] for row in rows.values())
    assert rows["plane look-up"]["compiled"]["error"] < 1e-4
    assert all(row["twin"]["operations"] > 0 for row in rows.values())
    iteration = found(rehearsal, "kernels")["iteration"]
    assert iteration["compiled twins"]["graphs_compiled"] > 0
    assert iteration["twins"]["iterations_per_second"] > 0


@pytest.mark.slow
def test_speed_and_training_have_their_figures(rehearsal: dict[str, Any]) -> None:
    assert found(rehearsal, "bench")["growth"][0]["iterations_per_second"] > 0
    assert set(found(rehearsal, "bench")["methods"]) == {"fourdgs", "d3dgs"}
    for preset in ("quick", "paper"):
        row = found(rehearsal, "train")[preset]
        assert row["iterations"] == row["of"] == 10
        assert row["scores_on_cpu"]["psnr"] > 5
    assert found(rehearsal, "train")["on_the_cpu"]["quick"]["psnr"] > 20


def test_a_part_that_fails_is_told_and_the_next_one_runs(tmp_path: Path) -> None:
    asked = Asked("cpu", str(tmp_path), is_tiny=True)
    result = check(asked, tmp_path / "out.json", ["train", "environment"], 600, again=False)
    assert result["parts"]["train"]["status"] == "failed"
    assert "give a capture to train on" in result["parts"]["train"]["found"]["traceback"]
    assert result["parts"]["environment"]["status"] == "done"
    assert result["parts"]["environment"]["found"]["torch"]["version"]
    assert json.loads((tmp_path / "out.json").read_text()) == result
    # Once more: what is done stays, what failed is tried again.
    (tmp_path / "environment.json").unlink()
    assert check(asked, tmp_path / "out.json", ["train", "environment"], 600, again=False)["parts"] == {
        "train": {**result["parts"]["train"], "seconds": pytest.approx(10, abs=100)},
        "environment": result["parts"]["environment"],
    }
    assert not (tmp_path / "environment.json").exists()


def test_a_part_that_hangs_is_ended_and_what_it_found_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = tmp_path / "site" / "sitecustomize.py"  # every part's own folder of packages
    slow.parent.mkdir()
    slow.write_text("import sys, time, pathlib\npathlib.Path(sys.argv[0])\ntime.sleep(60)\n")
    monkeypatch.setitem(PARTS, "environment", 1)
    result = check(Asked("cuda", str(tmp_path)), tmp_path / "out.json", ["environment"], 100, again=False)
    assert result["parts"]["environment"]["status"] == "out of time"
    assert result["parts"]["environment"]["seconds"] < 30


def test_only_kernels_that_the_project_can_ask_for_are_built(tmp_path: Path) -> None:
    source = tmp_path / "gsplat-1.5.3/gsplat/cuda/csrc"
    source.mkdir(parents=True)
    instances = "".join(f"__INS__({n})\n" for n in build.CHANNELS)
    kernels = f"#define __INS__(CDIM) a\\\n    b(CDIM)\n{instances}#undef __INS__\n"
    (source / "RasterizeToPixels3DGSFwd.cu").write_text(kernels)
    (source / "Rasterization.cpp").write_text("".join(f"        __LAUNCH_KERNEL__({n})\n" for n in build.CHANNELS))
    archive = tmp_path / build.ARCHIVE
    with tarfile.open(archive, "w:gz") as file:
        file.add(tmp_path / "gsplat-1.5.3", "gsplat-1.5.3")
    unpacked = build.unpacked(archive, tmp_path / "work")
    assert build.prune(unpacked) == {"Rasterization.cpp": 9, "RasterizeToPixels3DGSFwd.cu": 9}
    text = (unpacked / "gsplat/cuda/csrc/RasterizeToPixels3DGSFwd.cu").read_text()
    assert "__INS__(32)\n#undef" in text
    assert "#define __INS__(CDIM) a" in text
    assert build.prune(unpacked) == {"Rasterization.cpp": 0, "RasterizeToPixels3DGSFwd.cu": 0}


def test_a_difference_without_a_reason_is_named() -> None:
    rows: dict[str, dict[str, Any]] = {
        "needle: along x, 1 m": {"within": False},
        "equal depths": {"within": False},
        "plain": {"within": True},
        "opacity of one": {"raised": "RuntimeError: no"},
    }
    summary = parity.summary(rows)
    assert summary["unexplained"] == ["equal depths", "opacity of one"]
    assert list(summary["explained"]) == ["needle: along x, 1 m"]
    assert summary["within_bounds"] == 1


def test_every_reason_belongs_to_a_hard_case() -> None:
    names = [case.name for case in parity.hard_cases.PART.cases]
    assert all(any(name.startswith(start) for name in names) for start in parity.EXPLAINED)


def test_bad_input_is_a_sentence(tmp_path: Path) -> None:
    write_toy_capture(tmp_path / "capture")
    for wrong, said in (("--parts=parity,speed", "'speed' is unknown"), ("--capture=nowhere", "there is no nowhere")):
        command = [sys.executable, "-m", "tests.device", "--out", str(tmp_path / "a.json"), wrong]
        result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert result.returncode == 2
        assert said in result.stderr
    assert not (tmp_path / "a.json").exists()

"""The command line: refusals, resuming, and both ways to start it."""

import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from synth.develop import png, read_png, srgb_from_linear
from synth.files import write_bytes
from synth.workers import shards

SCRIPT = Path(__file__).resolve().parents[2] / "synth" / "render_flyover.py"
Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]
needs_bpy = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")


def refused(result: "subprocess.CompletedProcess[str]") -> str:
    """The one sentence of a refusal."""
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]


def digests(capture: Path) -> dict[str, str]:
    """SHA-256 of every file but the timings."""
    files = [path for path in capture.rglob("*") if path.is_file() and path.name != "cost.json"]
    return {path.relative_to(capture).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_help_teaches(flyover: Command) -> None:
    result = flyover(["--help"])
    assert result.returncode == 0
    for word in ("SCENE", "--out", "blender -b -P", "docs/scenes.md"):
        assert word in result.stdout


def test_bad_scene_is_refused_before_anything_is_written(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    scene = tmp_path / "bad.toml"
    scene.write_text(tiny_scene.read_text().replace("radius_m", "radios_m"))
    message = refused(flyover([scene, "--out", tmp_path / "out"]))
    assert "flight.radios_m" in message
    assert "'radius_m'" in message
    assert not (tmp_path / "out").exists()


@needs_bpy
def test_folder_with_other_things_is_refused(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    assert "not empty" in refused(flyover([tiny_scene, "--out", tmp_path]))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@needs_bpy
def test_folder_that_cannot_be_written_is_refused(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is a file" in refused(flyover([tiny_scene, "--out", tmp_path / "file"]))
    assert "cannot write" in refused(flyover([tiny_scene, "--out", tmp_path / "file" / "below"]))


def test_capture_of_another_plan_is_refused(capture: Path, flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    scene = tmp_path / "other.toml"
    scene.write_text(tiny_scene.read_text().replace("samples = 2", "samples = 3"))
    before = digests(capture)
    message = refused(flyover([scene, "--out", capture]))
    assert "scene.render.samples is 2 there and 3 here" in message
    assert digests(capture) == before


def test_finished_capture_is_left_alone(capture: Path, flyover: Command, tiny_scene: Path) -> None:
    before = digests(capture)
    result = flyover([tiny_scene, "--out", capture])
    assert result.returncode == 0
    assert "complete already" in result.stdout
    assert digests(capture) == before


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_interrupted_render_continues_to_the_same_bytes(
    capture: Path, flyover: Command, tiny_scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = [sys.executable, str(SCRIPT), str(tiny_scene), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 120
        while not (out / "frames" / "000000.png").exists() and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    assert process.returncode == 130, stderr
    assert "same command continues" in stderr
    assert "Traceback" not in stderr
    assert not (out / "capture.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in (out / "frames").iterdir()}
    assert 1 <= len(kept) < 6
    (out / "frames" / "000005.png.part").write_bytes(b"half")  # as a power cut would leave it
    result = flyover([tiny_scene, "--out", out])
    assert result.returncode == 0, result.stderr
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert digests(out) == digests(capture)


def test_damaged_and_exchanged_files_are_made_again(
    capture: Path, full_capture: Path, flyover: Command, tiny_scene: Path, tmp_path: Path
) -> None:
    """Of a finished capture and of an unfinished one: no bytes, half a file, another valid file, a missing one."""
    expected = digests(full_capture)
    scene = full_capture.parent / "full.toml"
    out = Path(shutil.copytree(full_capture, tmp_path / "finished"))
    (out / "frames/000001.png").write_bytes(b"")
    (out / "truth/000002.npz").write_bytes((out / "truth/000002.npz").read_bytes()[:-100])
    shutil.copy(out / "frames/000004.png", out / "frames/000003.png")
    shutil.copy(out / "truth/flow/000001.npz", out / "truth/flow/000002.npz")
    (out / "points.ply").write_bytes(b"")
    (out / "truth/boxes.npz").unlink()
    (out / "cost.json").write_bytes(b"")
    result = flyover([scene, "--out", out])
    assert result.returncode == 0, result.stderr
    assert "frames/000001.png" in result.stdout
    assert "and 2 more" in result.stdout
    assert digests(out) == expected

    (out / "capture.json").write_bytes(b"")
    result = flyover([scene, "--out", out])
    assert "made again: capture.json" in result.stdout
    assert digests(out) == expected
    assert "complete already" in flyover([scene, "--out", out]).stdout

    out = tmp_path / "unfinished"
    (out / "truth").mkdir(parents=True)
    (out / "frames").mkdir()
    shutil.copy(capture / "plan.json", out / "plan.json")
    lines = []
    for name, source in (("frames/000000.png", "000000.png"), ("frames/000001.png", "000005.png")):
        shutil.copy(capture / "frames" / source, out / name)  # the second is somebody else's
        lines.append(f"{digests(capture)[name]}  {name}\n")
    (out / "unfinished.sha256").write_text("".join(lines) + "0" * 30)  # the last line was cut short
    shutil.copy(capture / "truth/000000.npz", out / "truth/000000.npz")  # whole, but not in the ledger
    kept = (out / "frames/000000.png").stat().st_mtime_ns
    result = flyover([tiny_scene, "--out", out])
    assert result.returncode == 0, result.stderr
    assert "made again: frames/000001.png" in result.stdout
    assert (out / "frames/000000.png").stat().st_mtime_ns == kept
    assert digests(out) == digests(capture)


def test_two_workers_write_the_same_bytes(capture: Path, full_capture: Path) -> None:
    """The tiny scene by one process, and by two with more passes."""
    for frame in sorted((capture / "frames").iterdir()):
        assert frame.read_bytes() == (full_capture / "frames" / frame.name).read_bytes()
    for k in range(6):
        with np.load(capture / f"truth/{k:06d}.npz") as one, np.load(full_capture / f"truth/{k:06d}.npz") as two:
            for name in one:
                np.testing.assert_array_equal(one[name], two[name])


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
@needs_bpy
def test_interrupted_workers_finish_their_frame_and_go_on(
    capture: Path, flyover: Command, tiny_scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = [sys.executable, str(SCRIPT), str(tiny_scene), "--out", str(out), "--workers", "3"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 120
        while not list((out / "frames").glob("*.png")) and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert not list(out.rglob("*.part"))
    result = flyover([tiny_scene, "--out", out, "--workers", "2"])
    assert result.returncode == 0, result.stderr
    assert digests(out) == digests(capture)


def test_a_write_that_is_interrupted_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_bytes(tmp_path / "frame.png", b"whole")

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(tmp_path / "frame.png", b"half")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("frame.png", b"whole")]


def test_shards_keep_neighbours_together() -> None:
    plan_frames = list(range(100))
    assert [len(piece) for piece in shards(plan_frames, 1)] == [48, 48, 4]  # type: ignore[arg-type]
    assert [len(piece) for piece in shards(plan_frames, 4)] == [25, 25, 25, 25]  # type: ignore[arg-type]
    assert shards([], 4) == []
    assert shards(plan_frames[:2], 4) == [[0], [1]]  # type: ignore[arg-type,comparison-overlap]


@needs_bpy
def test_arguments_after_two_dashes_as_blender_passes_them(tmp_path: Path) -> None:
    """What `blender -b -P` does, with the bpy module: bpy is loaded, the command line is Blender's."""
    code = (
        f"import bpy, runpy, sys; sys.argv = ['blender', '-b', '-P', 'x.py', '--', 'absent.toml', '--out', 'y'];"
        f"runpy.run_path({str(SCRIPT)!r}, run_name='__main__')"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path, check=False)
    assert "absent.toml: cannot read" in refused(result)


@pytest.mark.skipif(shutil.which("blender") is None, reason="needs a blender binary on the path")
def test_blender_runs_the_script(tiny_scene: Path, tmp_path: Path) -> None:
    command = ["blender", "-b", "-P", str(SCRIPT), "--", str(tiny_scene), "--out", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "out" / "capture.json").is_file()


def test_png_reads_back(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, size=(7, 5, 3), dtype=np.uint8)
    (tmp_path / "x.png").write_bytes(png(image))
    with Image.open(tmp_path / "x.png") as read:
        np.testing.assert_array_equal(np.asarray(read), image)


def test_srgb_is_the_standard_curve() -> None:
    linear = np.array([-1.0, 0.0, 0.0031308, 0.18, 0.5, 1.0, 7.0], dtype=np.float32)
    np.testing.assert_array_equal(srgb_from_linear(linear), [0, 0, 10, 118, 188, 255, 255])


def test_own_pictures_read_back_and_damaged_ones_do_not() -> None:
    rng = np.random.default_rng(1)
    for shape in ((7, 5, 3), (4, 9)):
        image = rng.integers(0, 256, size=shape, dtype=np.uint8)
        np.testing.assert_array_equal(read_png(png(image)), image)
    content = bytearray(png(image))
    content[-15] ^= 1
    for bad in (bytes(content), b"GIF89a", *(png(image)[:end] for end in range(len(png(image)) - 12))):
        with pytest.raises(ValueError, match="PNG"):
            read_png(bad)


def test_explain_renders_nothing(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    scene = tmp_path / "s.toml"
    scene.write_text(tiny_scene.read_text() + "\n[effects.haze]\nvisibility_m = 250\n")
    result = flyover([scene, "--explain"])
    assert result.returncode == 0, result.stderr
    assert "6 frames of 96x54" in result.stdout
    assert "film     haze: visibility_m 250.0" in result.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["s.toml"]
    assert "--workers 0: must be at least 1" in refused(flyover([scene, "--out", tmp_path / "x", "--workers", 0]))

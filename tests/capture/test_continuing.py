"""A capture that is stopped, repeated, changed, damaged or made twice at once."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from aa4d.capture import colmap
from aa4d.capture.reader import read_capture, read_images
from aa4d.capture.settings import Selection
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.workspace import Progress
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.making import QUICK, SETTINGS, Watch, clip_of, make, pose_errors


def test_nothing_is_done_twice(made: CaptureSummary, flight: Path) -> None:
    watch = Watch()
    before = (made.folder / "capture.json").read_bytes()
    again = make(flight, made.folder, watch=watch)
    assert watch.ran == []
    assert (made.folder / "capture.json").read_bytes() == before
    assert again.seconds == made.seconds


def test_a_changed_setting_repeats_what_depends_on_it(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    watch = Watch()
    smaller = make(flight, folder, replace(SETTINGS, size_px=160), watch)
    assert watch.ran == ["pictures", "capture"]
    assert max(read_capture(smaller.folder).camera.width, read_capture(smaller.folder).camera.height) <= 160
    assert pose_errors(folder, aerial.arc())[0] == pytest.approx(pose_errors(made.folder, aerial.arc())[0])


def test_repeated_from_scratch_the_cameras_are_the_same(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    again = make(flight, tmp_path / "again")
    first, second = read_capture(made.folder), read_capture(again.folder)
    for a, b in zip(first.frames, second.frames, strict=True):
        assert np.allclose(a.viewmat, b.viewmat, atol=1e-6)


def test_another_input_or_other_things_in_the_folder_are_refused(
    made: CaptureSummary, flight: Path, tmp_path: Path
) -> None:
    other = aerial.write(tmp_path / "other", aerial.pictures(aerial.arc(4)))
    with pytest.raises(InputError, match=r"holds a capture of .*frames; choose a new folder"):
        make(other, made.folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="no unfinished work of `aa4d capture`"):
        make(flight, tmp_path / "mine")
    with pytest.raises(InputError, match="no unfinished work of `aa4d capture`"):
        make(flight, tmp_path / "new/../mine")  # a way round through a folder that is not there yet
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_two_processes_do_not_make_one_capture(flight: Path, tmp_path: Path) -> None:
    """The second is refused, whatever the first has written by then, and takes nothing away."""
    refusals = []

    class Second(Watch):
        def __call__(self, name: str, was_done: bool) -> Progress:
            with pytest.raises(InputError, match="another process is making a capture there; wait for it"):
                make(flight, tmp_path / "capture")
            refusals.append(name)
            return super().__call__(name, was_done)

    assert make(flight, tmp_path / "capture", watch=Second()).frames == 9
    assert refusals == ["frames", "features", "matches", "cameras", "pictures", "capture"]
    # What a killed process has left without its record is taken over.
    (tmp_path / "killed/work").mkdir(parents=True)
    (tmp_path / "killed/.lock").touch()
    outside = replace(SETTINGS, selection=Selection(source_fps=10.0, start_s=60))
    with pytest.raises(InputError, match="no frame lies between"):
        make(flight, tmp_path / "killed", outside)
    assert list((tmp_path / "killed").iterdir()) == []


def test_a_refusal_leaves_an_earlier_capture_as_it_was(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    outside = replace(SETTINGS, selection=Selection(source_fps=10.0, start_s=60))
    with pytest.raises(InputError, match="no frame lies between"):
        make(flight, folder, outside)
    assert list((folder / "work").glob("*.part")) == []
    assert (folder / "capture.json").read_bytes() == (made.folder / "capture.json").read_bytes()
    assert read_images(read_capture(folder), [0]).shape[0] == 1
    assert make(flight, folder).frames == 9


def contents(folder: Path) -> dict[str, bytes]:
    """Of all that a capture is made of: not the report, whose seconds differ, and not work/."""
    files = [p for p in folder.rglob("*") if p.is_file() and p.relative_to(folder).parts[0] not in ("work", ".lock")]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files if p.name not in ("report.html", "cost.json")}


@pytest.mark.parametrize(
    ("damage", "ran"),
    [
        (lambda c: (c / "capture.json").unlink(), ["capture"]),
        (lambda c: (c / "capture.json").write_text("{"), ["capture"]),
        (lambda c: (c / "points.ply").write_bytes(b""), ["capture"]),
        (lambda c: shutil.rmtree(c / "sparse"), ["capture"]),
        (
            lambda c: (c / "transforms.json").write_text((c / "transforms.json").read_text().replace("1", "2")),
            ["capture"],
        ),
        (lambda c: (c / "frames/000003.png").unlink(), ["pictures", "capture"]),
        (lambda c: (c / "frames/000003.png").write_bytes(b""), ["pictures", "capture"]),  # in work/ too, by its link
        (lambda c: (c / "work/pictures/000003.png").write_bytes(b""), ["pictures", "capture"]),
        (lambda c: shutil.rmtree(c / "work/cameras/model"), ["cameras", "pictures", "capture"]),
    ],
)
def test_a_damaged_capture_is_mended(
    flight: Path, made: CaptureSummary, tmp_path: Path, damage: Any, ran: list[str]
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    for link in (folder / "work/pictures").glob("*.png"):  # which copying has taken apart
        link.unlink()
        os.link(folder / "frames" / link.name, link)
    damage(folder)
    watch = Watch()
    make(flight, folder, watch=watch)
    assert watch.ran == ran
    assert contents(folder) == contents(made.folder)


def test_stopped_and_continued(flight: Path, tmp_path: Path) -> None:
    """Ctrl-C in the command itself: exit code 130, and the next call repeats no finished step."""
    command = [sys.executable, "-m", "aa4d.cli", "capture", str(flight), "--out", str(tmp_path / "c")]
    command += ["--preset", "fast", "--movers", "off", "--threads", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    features = tmp_path / "c/work/features/done.json"
    deadline = time.monotonic() + 60
    while not features.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "the same command continues" in said
    assert not (tmp_path / "c/capture.json").exists()
    stamp = os.stat(features).st_mtime_ns
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert finished.returncode == 0, finished.stderr
    assert "features: done before" in finished.stdout
    assert "next:    aa4d train" in finished.stdout
    assert os.stat(features).st_mtime_ns == stamp


def test_ctrl_c_while_a_stage_starts_stops_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """An exception out of Thread.start would leave the stage running when the process ends, which aborts it."""
    start, ended = threading.Thread.start, threading.Event()

    def interrupted_start(thread: threading.Thread) -> None:
        start(thread)
        signal.raise_signal(signal.SIGINT)

    def stage(token: Any) -> None:
        deadline = time.monotonic() + 30
        while not token.is_cancelled and time.monotonic() < deadline:
            time.sleep(0.01)
        if token.is_cancelled:
            ended.set()

    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    with pytest.raises(KeyboardInterrupt):
        colmap.run(stage, tmp_path)
    assert ended.is_set()


def test_features_go_on_in_the_middle(made: CaptureSummary, tmp_path: Path) -> None:
    """What a killed run has stored is kept, and all frames stay those of one camera."""

    from aa4d.capture import features

    whole = clip_of(made)
    features.extract(replace(whole, frames=whole.frames[:3]), None, QUICK, None, 1, tmp_path, lambda *_: None)
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        before = {i.name: database.read_keypoints(i.image_id) for i in database.read_all_images()}
    found = features.extract(whole, None, QUICK, None, 1, tmp_path, lambda *_: None)
    assert len(found.features) == 9
    assert min(found.features) > 100
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        assert database.num_cameras() == 1
        for image in database.read_all_images():
            if image.name in before:
                assert np.array_equal(database.read_keypoints(image.image_id), before[image.name])
    assert set(before) == {frame.file for frame in whole.frames[:3]}

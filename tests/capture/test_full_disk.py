"""COLMAP on a disk that fills."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pycolmap
import pytest
from PIL import Image

from aa4d.capture import colmap
from aa4d.capture.focal import map_globally
from aa4d.capture.mapping import adopt_step
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.workspace import Workspace
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.making import clip_of


def test_a_disk_that_fills_while_a_stage_runs_stops_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """COLMAP would wait for its database for ever, or take the failed write for success."""
    free, ended = [1 << 30, 1 << 30, 800_000], threading.Event()

    def disk_usage(_: Path) -> SimpleNamespace:
        return SimpleNamespace(free=free.pop(0) if len(free) > 1 else free[0])

    def stage(token: Any) -> None:
        deadline = time.monotonic() + 30
        while not token.is_cancelled and time.monotonic() < deadline:
            time.sleep(0.01)
        if token.is_cancelled:
            ended.set()

    monkeypatch.setattr(shutil, "disk_usage", disk_usage)
    with pytest.raises(OSError, match="less than 4 MiB are free") as full:
        colmap.run(stage, tmp_path)
    assert full.value.errno == errno.ENOSPC
    assert ended.is_set()
    with pytest.raises(OSError, match="less than 32 MiB are free"):
        colmap.run(stage, tmp_path)


def test_a_database_that_finds_no_room_beside_itself_is_a_full_disk(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """COLMAP says of a -shm file that it cannot write: No registered database factory succeeded."""
    (tmp_path / "database.db").mkdir()  # cannot be opened either
    with pytest.raises(RuntimeError, match="database"), colmap.opened(tmp_path / "database.db"):
        pass
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=20_000))
    with pytest.raises(OSError, match="less than 4 MiB are free"), colmap.opened(tmp_path / "database.db"):
        pass


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize("left", [0, 20])
def test_a_model_that_could_not_be_written_is_noticed_and_the_same_command_heals(
    made: CaptureSummary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, left: int
) -> None:
    model, clip = pycolmap.Reconstruction(made.folder / "work/cameras/model"), clip_of(made)

    def adopted() -> Any:
        return Workspace(tmp_path / "work", lambda *_: lambda *_: None).run(adopt_step(clip, model))

    write = pycolmap.Reconstruction.write

    def write_until_full(self: Any, folder: Path) -> None:
        write(self, folder)
        (folder / file).write_bytes((folder / file).read_bytes()[:left])

    monkeypatch.setattr(pycolmap.Reconstruction, "write", write_until_full)
    with pytest.raises(InputError, match=r"no space is left .*COLMAP could not write its model.*the same command"):
        adopted()
    monkeypatch.undo()
    whole = adopted()
    assert whole.read().num_reg_images() == len(clip.frames)
    # As an earlier version left it: recorded as done.
    (whole.folder / "model" / file).write_bytes(b"")
    record = json.loads((whole.folder / "done.json").read_text())
    record["sizes"][f"model/{file}"] = 0
    (whole.folder / "done.json").write_text(json.dumps(record))
    assert adopted().read().num_points3D() == model.num_points3D()


def test_a_global_mapper_that_fails_on_a_full_disk_is_no_verdict_on_the_footage(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "empty.db").touch()
    ended = SimpleNamespace(returncode=1)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=800_000))
    with pytest.raises(OSError, match="less than 4 MiB are free"):
        map_globally(tmp_path / "empty.db", tmp_path, ["a.png"], 0, 1, tmp_path / "found")


def test_a_full_disk_is_told_and_leaves_no_capture(tmp_path: Path) -> None:
    """The real thing: the process may write no file beyond 30 kB."""
    images = aerial.pictures(aerial.arc())
    source = aerial.write(tmp_path / "frames", images)
    (source / "frame_0003.png").unlink()
    Image.fromarray(images[3]).save(source / "frame_0003.bmp")  # has to be written anew
    program = (
        "import resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "from aa4d.commands.capture import capture\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))\n"
        "from aa4d.cli import main\n"
        f"sys.argv = ['aa4d', 'capture', {str(source)!r}, '--out', {str(tmp_path / 'capture')!r}]\n"
        "main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2, ended.stderr
    assert "no space is left on the disk" in ended.stderr
    assert "run the same command again" in ended.stderr
    assert not (tmp_path / "capture/capture.json").exists()
    assert (tmp_path / "capture/work/frames.part").exists()  # from which it goes on

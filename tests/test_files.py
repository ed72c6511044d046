"""Files that are whole or absent, also where the disk is full."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import IO, Any

import pytest

from aa4d import files
from aa4d.files import whole_file


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file can be appended to: what a full disk is to whoever asks it."""
    plain = Path.open

    def refuse(path: Path, mode: str = "r", *rest: Any, **named: Any) -> IO[Any]:
        if mode == "ab":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return plain(path, mode, *rest, **named)

    monkeypatch.setattr(Path, "open", refuse)


def test_what_a_library_says_of_a_full_disk_becomes_the_disks_own_error(tmp_path: Path, full_disk: None) -> None:  # noqa: ARG001
    (tmp_path / "model").write_text("before")
    with pytest.raises(OSError, match="No space left") as full, whole_file(tmp_path / "model"):
        raise RuntimeError("Error while serializing")
    assert full.value.filename == str(tmp_path / "model")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("model", "before")]


def test_what_a_library_quotes_of_the_system_is_believed(tmp_path: Path) -> None:
    """It may have deleted its file already: there is room again."""
    with pytest.raises(OSError, match="No space left") as full, whole_file(tmp_path / "model"):
        raise RuntimeError("Error while serializing: No space left on device (os error 28)")
    assert full.value.errno == errno.ENOSPC


def test_any_other_error_stays_what_it_is(tmp_path: Path) -> None:
    def fail(temporary: Path) -> None:
        temporary.write_text("half")
        raise RuntimeError("of its own")

    with pytest.raises(RuntimeError, match="of its own"), whole_file(tmp_path / "model") as temporary:
        fail(temporary)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_is_removed_and_what_is_being_written_stays(tmp_path: Path) -> None:
    left = tmp_path / ".x.json.ab12_cd9.part.json"
    mine = [tmp_path / name for name in (".notes.part", ".thesis.partial", ".x.json.ab12_cd9.part.txt", "x.part")]
    for path in (left, *mine):
        path.write_text("half")
    with whole_file(tmp_path / "model") as temporary:
        temporary.write_text("whole")
        files.remove_unfinished(tmp_path)  # as another process would
        assert temporary.exists()
    assert {p.name for p in tmp_path.iterdir()} == {"model", *(path.name for path in mine)}


def test_an_error_names_the_file_and_not_the_temporary_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing, whole_file(tmp_path / "nowhere" / "x.json"):
        pass
    assert missing.value.filename == str(tmp_path / "nowhere" / "x.json")
    with pytest.raises(OSError, match="No space") as full, whole_file(tmp_path / "x.json"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert full.value.filename == str(tmp_path / "x.json")
    with pytest.raises(FileNotFoundError) as other, whole_file(tmp_path / "x.json"):
        (tmp_path / "input").read_bytes()
    assert other.value.filename == str(tmp_path / "input"), "what was read is not what is written"

"""A capture's identity: what changes it, what does not, and what is found damaged."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from aa4d.capture.content import CHECKSUMS, check_content, content_of, digests_of
from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.files import write_json
from aa4d.identity import Identity
from aa4d.training.trainer import train
from tests.training.short_run import SHORT


def silent(*_: object) -> None:
    pass


def identify(folder: Path, made_from: dict[str, str] | None = None) -> Path:
    """Write checksums and identity as the makers of captures do."""
    index: dict[str, Any] = json.loads((folder / "capture.json").read_text())
    files = digests_of(folder)
    write_json(folder / CHECKSUMS, files)
    identity = Identity("capture", content_of(index, files), made_from or {"plan": "a"})
    write_json(folder / "capture.json", index | {"identity": identity.as_json()})
    return folder


def change_frame(folder: Path, name: str = "000003") -> None:
    path = folder / f"frames/{name}.png"
    shutil.copyfile(folder / "frames/000004.png", path)


def edit(folder: Path, **keys: Any) -> None:
    index = json.loads((folder / "capture.json").read_text())
    write_json(folder / "capture.json", index | keys)


def test_an_old_capture_is_hashed_and_its_copy_is_the_same(toy_capture: Path, tmp_path: Path) -> None:
    before = read_capture(toy_capture).identity
    assert before.made_from == {}
    shutil.copytree(toy_capture, tmp_path / "moved")
    for name in ("cost.json", "plan.json", "report.html", "notes.txt"):
        (tmp_path / "moved" / name).write_text("{}")
    (tmp_path / "moved/work").mkdir()
    (tmp_path / "moved/work/part").touch()
    assert read_capture(tmp_path / "moved").identity == before
    change_frame(tmp_path / "moved")
    assert read_capture(tmp_path / "moved").identity != before


def test_the_identity_is_that_which_the_maker_wrote(toy_capture: Path) -> None:
    written = json.loads((identify(toy_capture) / "capture.json").read_text())["identity"]
    assert read_capture(toy_capture).identity.as_json() == written


@pytest.mark.parametrize(
    "keys", [{"fps": 12.0}, {"instances": []}, {"identity": {"kind": "capture", "version": 1, "made_from": {}}}]
)
def test_an_edited_index_is_another_capture_whatever_it_says_of_itself(toy_capture: Path, keys: dict[str, Any]) -> None:
    before = read_capture(identify(toy_capture)).identity
    edit(toy_capture, **keys)
    assert read_capture(toy_capture).identity != before


def test_equal_frames_of_two_plans_are_two_captures(toy_capture: Path) -> None:
    before = read_capture(identify(toy_capture, {"plan": "a"})).identity
    after = read_capture(identify(toy_capture, {"plan": "b"})).identity
    assert (before.content, before == after) == (after.content, False)


def test_who_made_it_when_is_not_its_content(toy_capture: Path) -> None:
    before = read_capture(identify(toy_capture)).identity
    edit(toy_capture, generator={"program": "another"})
    assert read_capture(toy_capture).identity == before


def test_a_frame_that_was_changed_is_found_before_it_is_used(toy_capture: Path, tmp_path: Path) -> None:
    before = read_capture(identify(toy_capture))
    train(before, tmp_path / "run", SHORT, silent)
    change_frame(toy_capture)
    damaged = read_capture(toy_capture)
    says = r"000003\.png: was changed since the capture was made; make the capture"
    with pytest.raises(InputError, match=says):
        train(damaged, tmp_path / "another", SHORT, silent)
    assert not (tmp_path / "another").exists()
    with pytest.raises(InputError, match=says):
        train(damaged, tmp_path / "run", SHORT, silent)
    with pytest.raises(InputError, match=says):
        evaluate(tmp_path / "run", toy_capture, silent)
    (toy_capture / CHECKSUMS).unlink()
    check_content(toy_capture)
    after = read_capture(toy_capture)
    assert after.identity != before.identity
    with pytest.raises(InputError, match="holds a run with another capture"):
        train(after, tmp_path / "run", SHORT, silent)


def test_what_is_not_read_here_may_be_left_out_of_a_copy(toy_capture: Path) -> None:
    (toy_capture / "sparse").mkdir()
    (toy_capture / "sparse/points.txt").write_text("1")
    identify(toy_capture)
    shutil.rmtree(toy_capture / "sparse")
    check_content(toy_capture)
    (toy_capture / "truth/000005.npz").unlink()
    with pytest.raises(InputError, match=r"000005\.npz: is missing; make the capture again"):
        check_content(toy_capture)


@pytest.mark.parametrize("content", ["[]", "{", '{"../../secret": "ab"}', '{"/etc/passwd": "ab"}', '{"a": 3}'])
def test_damaged_checksums_are_refused(toy_capture: Path, content: str) -> None:
    (toy_capture / CHECKSUMS).write_text(content)
    with pytest.raises(InputError, match=r"checksums\.json"):
        read_capture(toy_capture)


def test_a_capture_that_cannot_be_written_to_is_read(toy_capture: Path) -> None:
    for path in (toy_capture, *toy_capture.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    before = {p: p.stat().st_mtime_ns for p in toy_capture.rglob("*")}
    assert read_capture(toy_capture).identity == read_capture(toy_capture).identity
    assert {p: p.stat().st_mtime_ns for p in toy_capture.rglob("*")} == before
    for path in (toy_capture, *toy_capture.rglob("*")):
        path.chmod(0o755)


def test_a_file_that_no_checksum_covers_is_refused(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    write_json(toy_capture / CHECKSUMS, digests_of(toy_capture))
    check_content(toy_capture)
    files = digests_of(toy_capture)
    del files[capture.frames[0].image]
    write_json(toy_capture / CHECKSUMS, files)
    with pytest.raises(InputError, match=rf"checksums\.json: does not list {capture.frames[0].image}"):
        check_content(toy_capture)

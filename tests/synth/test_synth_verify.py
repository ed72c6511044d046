"""The self-check passes on what was rendered, and finds every planted error by the check that should."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from synth.errors import InputError
from synth.files import write_json, write_npz
from synth.truth import PASSES
from synth.truth.recording import Recording
from synth.verify import Row, check_activity, check_files, check_flow, check_instances, check_reprojection, verify

Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def spoilt(full_capture: Path, tmp_path: Path) -> Path:
    """A copy to plant an error in."""
    return Path(shutil.copytree(full_capture, tmp_path / "capture"))


def edit_index(root: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = root / "capture.json"
    index = json.loads(path.read_text())
    change(index)
    write_json(path, index)


def edit_arrays(root: Path, names: list[str], change: Callable[[dict[str, np.ndarray]], None]) -> None:
    for name in names:
        with np.load(root / name) as arrays:
            content = dict(arrays)
        change(content)
        write_npz(root / name, **content)


def failing(rows: Sequence[Row]) -> set[str]:
    return {row.check for row in rows if not row.passes}


def reprojection(root: Path) -> set[str]:
    return failing(list(check_reprojection(Recording(root), lambda: None)))


def truths(root: Path) -> list[str]:
    return [frame["truth"] for frame in json.loads((root / "capture.json").read_text())["frames"]]


def test_a_capture_agrees_with_itself(full_capture: Path) -> None:
    rows = verify(full_capture)
    assert failing(rows) == set()
    by_name = {row.check: row for row in rows}
    assert by_name["flow against depth, poses, motion"].p99 < 0.02
    assert by_name["reprojection to the next frame"].count > 5000
    assert by_name["reprojection to the next frame"].median < 1e-3
    assert by_name["pixels outside their instance's box"].count > 300
    assert {"occlusion", "visible pixels", "boxes in the picture", "activity of pixels", "class ids"} <= by_name.keys()
    recording = Recording(full_capture)
    assert (
        set(PASSES) - {"depth_z", "instance_id", "normal", "class_id"}
        <= recording.index.keys() | recording.index["frames"][0].keys()
    )


def test_a_capture_without_passes_is_checked_as_far_as_it_goes(capture: Path) -> None:
    rows = verify(capture)
    assert failing(rows) == set()
    assert not [row for row in rows if row.check == "occlusion"]
    assert {path.name for path in (capture / "truth").iterdir()} == {*(f"{k:06d}.npz" for k in range(6)), "tracks.npz"}


def test_half_a_pixel_of_principal_point_is_found(spoilt: Path) -> None:
    def shift(index: dict[str, Any]) -> None:
        index["camera"]["K"][0][2] += 0.5

    edit_index(spoilt, shift)
    # Matching planes hardly sees a shift within them; boxes do.
    assert "pixels outside their instance's box" in failing(list(check_instances(Recording(spoilt))))


def test_flipped_sign_of_the_flow_is_found(spoilt: Path) -> None:
    def flip(arrays: dict[str, np.ndarray]) -> None:
        arrays["flow_forward"] = -arrays["flow_forward"]

    edit_arrays(spoilt, ["truth/flow/000001.npz"], flip)
    assert failing(list(check_flow(Recording(spoilt), lambda: None))) == {"flow against depth, poses, motion"}


def test_poses_off_by_one_frame_are_found(spoilt: Path) -> None:
    def late(index: dict[str, Any]) -> None:
        poses = [frame["viewmat"] for frame in index["frames"]]
        for frame, pose in zip(index["frames"], [poses[0], *poses[:-1]], strict=True):
            frame["viewmat"] = pose

    edit_index(spoilt, late)
    # On a steady arc the shifted poses agree with each other, but not with the vehicles.
    assert "pixels outside their instance's box" in failing(list(check_instances(Recording(spoilt))))


def test_tracks_off_by_one_frame_are_found(spoilt: Path) -> None:
    def late(arrays: dict[str, np.ndarray]) -> None:
        arrays["object_to_world"] = np.roll(arrays["object_to_world"], 1, axis=0)

    edit_arrays(spoilt, ["truth/tracks.npz"], late)
    assert "pixels outside their instance's box" in failing(list(check_instances(Recording(spoilt))))


def test_depth_as_ray_length_is_found(spoilt: Path) -> None:
    rays = np.linalg.norm(Recording(spoilt).view(0).rays(), axis=-1)

    def stretch(arrays: dict[str, np.ndarray]) -> None:
        arrays["depth_z"] = (arrays["depth_z"] * rays).astype(np.float32)

    edit_arrays(spoilt, truths(spoilt), stretch)
    assert "reprojection over half the clip" in reprojection(spoilt)


def test_swapped_ids_are_found(spoilt: Path) -> None:
    def swap(arrays: dict[str, np.ndarray]) -> None:
        ids = arrays["instance_id"]
        arrays["instance_id"] = np.where(ids == 1, 2, np.where(ids == 2, 1, ids)).astype(np.uint32)

    edit_arrays(spoilt, truths(spoilt), swap)
    rows = verify(spoilt)
    assert {"pixels outside their instance's box", "visible pixels", "file hashes"} <= failing(rows)


def test_a_changed_byte_and_a_missing_file_are_found(spoilt: Path) -> None:
    image = spoilt / "frames" / "000002.png"
    content = bytearray(image.read_bytes())
    content[-20] ^= 1
    image.write_bytes(content)
    (spoilt / "points.ply").unlink()
    row = check_files(Recording(spoilt))
    assert (row.worst, row.passes) == (2.0, False)


def test_a_wrong_mask_is_found(spoilt: Path) -> None:
    def invert(arrays: dict[str, np.ndarray]) -> None:
        arrays["forward_valid"] = ~arrays["forward_valid"]

    edit_arrays(spoilt, ["truth/flow/000000.npz"], invert)
    assert "validity of the flow" in failing(list(check_flow(Recording(spoilt), lambda: None)))


def test_intervals_that_contradict_the_frames_are_found(spoilt: Path) -> None:
    def shift(arrays: dict[str, np.ndarray]) -> None:
        assert len(arrays["moving_interval"])
        arrays["moving_interval"] = arrays["moving_interval"] + [0, 0.6, 0.6]

    edit_arrays(spoilt, ["truth/activity.npz"], shift)
    assert failing(list(check_activity(Recording(spoilt)))) == {"intervals of motion"}


def test_paths_that_leave_the_folder_are_refused(spoilt: Path) -> None:
    edit_index(spoilt, lambda index: index.update(tracks="../tracks.npz"))
    with pytest.raises(InputError, match="leaves the capture folder"):
        Recording(spoilt)


def test_command_line(full_capture: Path, spoilt: Path, tmp_path: Path) -> None:
    def run(*arguments: object) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, str(ROOT / "synth" / "verify.py"), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    good = run(full_capture, "--json", tmp_path / "table.json")
    assert good.returncode == 0, good.stderr
    assert "reprojection to the next frame" in good.stdout
    assert all(row["passes"] for row in json.loads((tmp_path / "table.json").read_text()))
    (spoilt / "poses.tum").write_text("")
    bad = run(spoilt)
    assert bad.returncode == 1
    assert "does not agree with itself: file hashes" in bad.stderr
    none = run(tmp_path)
    assert none.returncode == 2
    assert "has no capture.json" in none.stderr
    assert none.stderr.count("\n") == 1

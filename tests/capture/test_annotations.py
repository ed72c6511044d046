"""Annotation files, and the masks and boxes that come of them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.annotations import Annotations, read_annotations
from aa4d.capture.clip import Clip, ClipFrame
from aa4d.capture.make import make_capture
from aa4d.capture.movers import box_mask, write_masks
from aa4d.capture.reader import read_capture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import open_source
from aa4d.capture.truth import boxes_of, moving_mask
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.given import SETTINGS, silent

GENUINE = Path(__file__).parents[3] / "shared/data/uavdt_gt/GT"


@pytest.mark.skipif(not GENUINE.is_dir(), reason="no genuine UAVDT files")
@pytest.mark.parametrize("sequence", ["M0101", "M0203", "M0601", "M1001"])
def test_genuine_uavdt_files(sequence: str) -> None:
    """Rows go by target, frames from 1: every row is found again under its frame."""
    path = GENUINE / f"{sequence}_gt_whole.txt"
    numbers = list(range(1, 5000))
    read = read_annotations(path, numbers)
    assert read.layout == "UAVDT"
    table = np.loadtxt(path, delimiter=",")
    assert sum(len(b) for b in read.boxes.values()) == len(table)
    assert min(read.boxes) == table[:, 0].min() >= 1
    frame = int(np.median(table[:, 0]))
    expected = table[table[:, 0] == frame][:, 2:6]
    assert np.array_equal(read.of(frame), expected)
    targets = np.concatenate([read.targets[number] for number in sorted(read.targets)])
    assert np.array_equal(np.sort(targets), np.sort(table[:, 1]))
    assert np.array_equal(read.targets[frame], table[table[:, 0] == frame][:, 1])
    assert read.follows
    # One target is one object: it has one category, and one box a frame, which overlaps with the next frame's.
    assert set(np.concatenate(list(read.categories.values()))) <= {"car", "truck", "bus"}
    target = int(np.bincount(table[:, 1].astype(int)).argmax())
    followed = {n: read.boxes[n][read.targets[n] == target] for n in sorted(read.boxes)}
    followed = {n: b[0] for n, b in followed.items() if len(b) == 1}
    assert len(followed) == (table[:, 1] == target).sum()
    moved = [np.abs(followed[n + 1][:2] - b[:2]).max() / b[2:].max() for n, b in followed.items() if n + 1 in followed]
    assert np.percentile(moved, 99) < 0.5
    # The file of evaluation has the same targets, and no category.
    scored = read_annotations(GENUINE / f"{sequence}_gt.txt", numbers)
    assert set(np.concatenate(list(scored.categories.values()))) == {""}
    with pytest.raises(InputError, match=r"ignore\.txt: holds regions to be ignored, not movers; .* \(M\d+_gt_whole"):
        read_annotations(GENUINE / f"{sequence}_gt_ignore.txt", numbers)


def test_rows_of_one_column_are_no_boxes(tmp_path: Path) -> None:
    (tmp_path / "M_gt.txt").write_text("1\n2\n")
    with pytest.raises(InputError, match="rows have 1 columns; known are 10"):
        read_annotations(tmp_path / "M_gt.txt", [1])


def test_an_empty_annotation_file_has_no_boxes(tmp_path: Path) -> None:
    (tmp_path / "M_gt.txt").write_text("")
    read = read_annotations(tmp_path / "M_gt.txt", [1])
    assert read.layout == "empty"
    assert read.of(1).shape == (0, 4)


def test_visdrone_rows_in_its_published_format(tmp_path: Path) -> None:
    """Made here after the format's description: no genuine file could be had."""
    file = tmp_path / "uav.txt"
    file.write_text("1,0,10,20,30,40,1,4,0,0\n2,0,11,21,30,40,1,4,0,1\n1,1,0,0,99,9,0,0,0,0\n2,3,5,6,7,8,1,1,0,0,\n")
    read = read_annotations(file, [1, 2])
    assert read.layout == "VisDrone"
    # Category 0 is a region that nobody has annotated, no mover.
    assert np.array_equal(read.of(1), [[10, 20, 30, 40]])
    assert np.array_equal(read.of(2), [[11, 21, 30, 40], [5, 6, 7, 8]])
    assert (read.targets[2].tolist(), read.categories[2].tolist()) == ([0, 3], ["car", "pedestrian"])
    file.write_text("1,-1,10,20,30,40,1,4,0,0\n")
    read = read_annotations(file, [1])
    assert (read.targets[1].tolist(), read.follows) == ([-1], False)


def test_boxes_without_size_are_left_out_and_counted(tmp_path: Path) -> None:
    (tmp_path / "one.txt").write_text("1,2,3,4\n0,0,0,0\n5,6,7,8\n")
    read = read_annotations(tmp_path / "one.txt", [1, 2, 3])
    assert (sorted(read.boxes), read.empty) == ([1, 3], 1)
    assert [read.targets[number].tolist() for number in (1, 3)] == [[1], [1]]  # one object is followed
    assert not read.follows  # and the others are not
    (tmp_path / "none.txt").write_text("1,7,10,20,0,0,1,1,1\n")
    read = read_annotations(tmp_path / "none.txt", [1])
    assert (read.boxes, read.empty) == ({}, 1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1,2,3\n", "rows have 3 columns; known are 10 .*: give a file of one of these kinds"),
        ("7,1,2,3,4,5,1,1,1\n", "boxes are of frames 7 to 7, .* numbered 1 to 1: give this sequence's own"),
        ("a,b\n", "line 1 is not a row of numbers"),
        ("1,2,3,nan\n", "line 1 holds no frame or pixel: '1,2,3,nan'"),
        ("1,2,3,4\n1,2,3,1e300\n", "line 2 holds no frame or pixel"),
        ("1e19,1,2,3,4,5,1,1,1\n", "line 1 holds no frame or pixel"),
        ("1,2,3,4\n1,2,3\n", "line 2 has another number of columns than the first"),
        ("1,2,3,4\n1,2,3,-1\n", "line 2 is a box of negative size"),
        ("1,1,2,3,-4,5,1,1,1\n", "line 1 is a box of negative size"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "x.txt").write_text(text)
    with pytest.raises(InputError, match=says):
        read_annotations(tmp_path / "x.txt", [1])


def test_boxes_are_in_the_source_pixels_and_have_a_border() -> None:
    frame = ClipFrame("0.png", "0.png", 0.0, 1, 1.0, None)
    clip = Clip(Path(), 160, 120, (320, 240), (frame,), ())
    mask = box_mask(clip, np.array([[100.0, 60, 40, 20], [-50, -50, 60, 60]]))
    rows, columns = np.nonzero(mask[20:, :])
    assert (columns.min(), columns.max()) == (44, 75)
    assert (rows.min() + 20, rows.max() + 20) == (27, 42)
    assert mask[0, 0]
    assert mask.mean() < 0.05


def test_boxes_of_larger_frames_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    frames = aerial.write(tmp_path / "frames", aerial.pictures(aerial.arc(4)))
    boxes = tmp_path / "gt.txt"
    boxes.write_text("1,1,900,500,40,20,1,1,1\n2,1,880,500,40,20,1,1,1\n3,1,100,100,40,20,1,1,1\n")
    with pytest.raises(InputError, match=r"gt\.txt: 2 of 3 boxes lie outside of the frames, which are 320x240"):
        make_capture(frames, tmp_path / "capture", SETTINGS, boxes, silent)
    assert not (tmp_path / "capture").exists()


def test_boxes_with_masks_switched_off_are_refused(tmp_path: Path) -> None:
    frames = aerial.write(tmp_path / "frames", aerial.pictures(aerial.arc(3)))
    with pytest.raises(InputError, match=r"gt\.txt: boxes are for masks, which --movers off switches off"):
        make_capture(frames, tmp_path / "capture", replace(SETTINGS, movers="off"), tmp_path / "gt.txt", silent)
    assert not (tmp_path / "capture").exists()


def test_a_range_without_any_box_is_told(tmp_path: Path) -> None:
    images = aerial.pictures(aerial.arc(2))
    folder = aerial.write(tmp_path / "clip", images)
    frames = tuple(ClipFrame(f"frame_{i:04}.png", str(i), i / 10, i + 1, 1.0, None) for i in range(2))
    clip = Clip(folder, 320, 240, (320, 240), frames, ())
    (tmp_path / "masks").mkdir()
    for number, notes in (
        (50, [f"{tmp_path / 'gt.txt'} has boxes for 0 of the 2 frames used: in the others no mover is masked"]),
        (2, []),
    ):
        boxes = Annotations(tmp_path / "gt.txt", "UAVDT", {number: np.array([[100.0, 100, 40, 20]])}, {}, {})
        (tmp_path / str(number)).mkdir()
        assert write_masks(clip, boxes, tmp_path / str(number), lambda *_: None).notes == tuple(notes)


def test_a_byte_order_mark_is_no_part_of_a_number(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("1,2,3,4\n", encoding="utf-8-sig")
    assert np.array_equal(read_annotations(tmp_path / "gt.txt", [1]).of(1), [[1, 2, 3, 4]])


def test_annotations_that_are_absent_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gt\.txt: cannot be read \(No such file.*give the annotation file"):
        read_annotations(tmp_path / "gt.txt", [1])
    (tmp_path / "gt.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"gt\.txt: is no text; give the annotation file"):
        read_annotations(tmp_path / "gt.txt", [1])
    with pytest.raises(InputError, match="file names have none; rename the frames"):
        read_annotations(tmp_path / "gt.txt", None)


def test_visdrone_layout_masks_the_boxes(tmp_path: Path) -> None:
    images = aerial.pictures(aerial.arc(5))
    frames = aerial.write(tmp_path / "val/sequences/uav0001", images, "{:07}.png")
    # Frames of VisDrone count from 1.
    for i in reversed(range(5)):
        (frames / f"{i:07}.png").rename(frames / f"{i + 1:07}.png")
    (tmp_path / "val/annotations").mkdir()
    rows = "".join(f"{i},0,{30 * i},100,40,30,1,4,0,0\n" for i in range(1, 6))
    (tmp_path / "val/annotations/uav0001.txt").write_text(rows)
    made = make_capture(frames, tmp_path / "capture", replace(SETTINGS, movers="twice"), None, silent)
    assert "--movers twice adds nothing: boxes say what moves" in made.notes
    document = json.loads((made.folder / "capture.json").read_text())
    assert document["generator"]["movers"] == "boxes (VisDrone)"
    told = re.fullmatch(r"boxes \(VisDrone\), ([0-9.]+) % of the pixels masked", made.movers)
    assert told is not None
    # Boxes of 40x30 in 320x240, and a border of 0.3 on every side; the last reaches over no edge.
    assert float(told[1]) == pytest.approx(100 * 64 * 48 / (320 * 240), rel=0.05)
    capture = read_capture(made.folder)
    scale = capture.camera.width / 320
    for i in range(5):
        mask = moving_mask(capture, i)
        assert mask is not None
        columns = np.nonzero(mask.any(axis=0))[0]
        middle = (columns.min() + columns.max()) / 2
        assert middle == pytest.approx((30 * (i + 1) + 20) * scale, abs=4)
    boxes = boxes_of(capture)
    assert boxes is not None
    assert (boxes.frame.tolist(), boxes.target.tolist(), set(boxes.category)) == ([0, 1, 2, 3, 4], [0] * 5, {"car"})
    middles = 0.5 * (boxes.box_px[:, :2] + boxes.box_px[:, 2:])
    K = capture.camera.K
    expected = [K[0, 2] + (30 * (i + 1) + 20 - 160) * scale for i in range(5)]  # the town has no distortion
    assert np.allclose(middles[:, 0], expected, atol=2)
    assert np.allclose(boxes.box_px[:, 2] - boxes.box_px[:, 0], 40 * scale, rtol=0.05)
    assert "movers/boxes.npz" in json.loads((made.folder / "work/capture/done.json").read_text())["result"]["files"]


def test_uavdt_layout_is_recognised(tmp_path: Path) -> None:
    frames = aerial.write(tmp_path / "UAV-benchmark-M/M0101", aerial.pictures(aerial.arc(3)), "img{:06}.png")
    truth = tmp_path / "UAV-benchmark-MOTD_v1.0/GT"
    truth.mkdir(parents=True)
    (truth / "M0101_gt_whole.txt").write_text("2,1,3,4,5,6,1,1,1\n1,1,3,4,5,6,1,1,1\n")
    source = open_source(frames, Selection(), None)
    assert source.annotations is not None
    assert source.annotations.layout == "UAVDT"

"""Sequence folders, annotation files, and folders whose cameras are known."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from aa4d.capture.annotations import Annotations, read_annotations
from aa4d.capture.clip import Clip, ClipFrame
from aa4d.capture.colmap_files import damaged
from aa4d.capture.intrinsics import check_intrinsics
from aa4d.capture.make import make_capture
from aa4d.capture.movers import box_mask, write_masks
from aa4d.capture.reader import read_capture
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.sources import Source, open_source
from aa4d.capture.sources.posed import same_shape
from aa4d.capture.truth import boxes_of, moving_mask
from aa4d.capture.workspace import Progress
from aa4d.capture.writing import Cloud, Shot, write_capture
from aa4d.errors import InputError
from tests.capture import aerial

GENUINE = Path(__file__).parents[3] / "shared/data/uavdt_gt/GT"
QUICK = replace(PRESETS["fast"], features=800, longest_px=320, window=3, keyframes=4)
SETTINGS = CaptureSettings("test", QUICK, Selection(source_fps=10.0), threads=1)


def silent(*_: object) -> Progress:
    return lambda *_: None


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
    made = make_capture(frames, tmp_path / "capture", SETTINGS, None, silent)
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


def given(folder: Path, with_points: bool) -> Path:
    """A folder with frames, true cameras and, if wanted, points, as `aa4d synth` writes them."""
    truth = aerial.arc()
    aerial.write(folder / "pictures", aerial.pictures(truth), "{:06}.png")
    generator = np.random.default_rng(0)
    ground = np.column_stack([generator.uniform(-12, 12, (400, 2)), np.zeros(400)])
    ground[:40, 2] = 6.0
    # The colours that the frames show there, for the self-check.
    first = truth[4]
    in_camera = ground @ first[:3, :3].T + first[:3, 3]
    at = (in_camera / in_camera[:, 2:]) @ aerial.K.T
    image = aerial.pictures([first])[0]
    colors = image[np.clip(at[:, 1].astype(int), 0, 239), np.clip(at[:, 0].astype(int), 0, 319)]
    cloud = Cloud(ground, colors.astype(np.uint8), np.ones(400), np.arange(400))
    shots = [Shot(f"{i:06}", f"{i:06}", i / 10, v) for i, v in enumerate(truth)]
    camera = PinholeCamera(aerial.WIDTH, aerial.HEIGHT, aerial.K)
    write_capture(folder, "given", folder / "pictures", camera, shots, cloud, {})
    if not with_points:
        import shutil

        shutil.rmtree(folder / "sparse")
    return folder


def test_a_capture_keeps_its_world_its_metres_and_its_times(tmp_path: Path) -> None:
    """It has its cameras twice: nerfstudio's are in its world, COLMAP's would be turned and scaled anew."""
    source = given(tmp_path / "given", with_points=True)
    settings = replace(SETTINGS, selection=Selection(source_fps=77), movers="off")
    made = make_capture(source, tmp_path / "capture", settings, None, silent)
    capture = read_capture(made.folder)
    assert made.frames == 9
    assert made.world.unit == "metres"
    assert "transforms.json, whose world is kept; capture.json says that it is in metres" in made.world.scale_from
    assert "cameras are those of transforms.json; sparse/0 is not read" in made.notes
    assert "--fps 77 is ignored: capture.json says its own times" in made.notes
    assert capture.fps == pytest.approx(10)
    for frame, viewmat in zip(capture.frames, aerial.arc(), strict=True):
        assert np.allclose(frame.viewmat, viewmat, atol=1e-6)
    assert np.allclose(capture.camera.K, aerial.K)
    # Ground and roofs where they are.
    assert np.median(np.abs(capture.points[:, 2])) < 0.2
    assert np.percentile(capture.points[:, 2], 98) > 3


def test_cameras_of_an_unknown_unit_are_not_taken_for_metres(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    index = source / "capture.json"
    document = json.loads(index.read_text())
    document["generator"]["world"] = {"unit": "unit"}  # footage without satellite positions
    index.write_text(json.dumps(document))
    posed = open_source(source, Selection(), None).posed
    assert posed is not None
    assert not posed.is_metric
    index.unlink()
    opened = open_source(source, Selection(source_fps=20), None)
    assert opened.posed is not None
    assert not opened.posed.is_metric
    assert opened.times_s() == pytest.approx(np.arange(9) / 20)


def test_a_stated_field_of_view_for_cameras_that_have_theirs_is_refused(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    with pytest.raises(InputError, match="gives its cameras and their field of view; leave out --fov"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, fov_deg=50.0), None, silent)
    assert not (tmp_path / "capture").exists()


def test_a_colmap_model_is_levelled_and_its_frames_stay_as_they_are(tmp_path: Path) -> None:
    """A model that stands askew, with points and their tracks: as COLMAP leaves it."""
    import pycolmap

    source = given(tmp_path / "given", with_points=False)
    first = make_capture(source, tmp_path / "first", replace(SETTINGS, movers="off"), None, silent)
    model = pycolmap.Reconstruction(first.folder / "work/cameras/model")
    model.transform(pycolmap.Sim3d(0.3, pycolmap.Rotation3d(np.array([0.1, -0.5, 0.5, 0.7])), np.array([4.0, 5, 6])))
    colmap = tmp_path / "colmap"
    (colmap / "sparse/0").mkdir(parents=True)
    model.write(colmap / "sparse/0")
    aerial.write(colmap / "images", aerial.pictures(aerial.arc()), "{:06}.png")
    made = make_capture(colmap, tmp_path / "capture", replace(SETTINGS, movers="off", altitude_m=43.0), None, silent)
    assert made.frames == 9
    assert set(made.seconds) == {"frames", "cameras", "pictures", "capture"}
    capture = read_capture(made.folder)
    assert np.median(np.abs(capture.points[:, 2])) < 0.3
    heights = [(-f.viewmat[:3, :3].T @ f.viewmat[:3, 3])[2] for f in capture.frames]
    # Level flight stays level, at the height that 43 m from the cameras to what they see comes to.
    assert max(heights) - min(heights) < 0.1
    assert 34 < min(heights) < 43
    # A pinhole camera's frames are not sampled anew.
    with Image.open(made.folder / capture.frames[4].image) as image:
        assert np.array_equal(np.asarray(image), aerial.pictures(aerial.arc())[4])


def test_transforms_of_any_editor_and_of_none(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    text = (source / "transforms.json").read_text()
    (source / "transforms.json").write_text(text, encoding="utf-8-sig")
    assert open_source(source, Selection(), None).posed is not None
    for nonsense in ("[" * 100_000, '{"w": ' + "1" * 5000 + "}"):
        (source / "transforms.json").write_text(nonsense)
        with pytest.raises(InputError, match=r"transforms\.json: not readable as nerfstudio's cameras"):
            open_source(source, Selection(), None)


SHEARED = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]  # its determinant is 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(frames=[]), '"frames" is missing or empty'),
        (lambda d: d.update(camera_model="OPENCV_FISHEYE"), "OPENCV_FISHEYE"),
        (lambda d: d["frames"][0]["transform_matrix"][0].__setitem__(0, 9.0), "not a rotation and a translation"),
        (lambda d: d["frames"][0].pop("file_path"), "key 'file_path' is missing, for frame 0; export it again"),
        (lambda d: d.pop("w"), "key 'w' is missing, for frame 0; export it again"),
        (lambda d: d.pop("fl_x"), "key 'fl_x' is missing"),
        (lambda d: d.update(h="tall"), "frame 0 cannot be understood"),
        (lambda d: d.update(w=math.inf), "frame 0 cannot be understood"),
        (lambda d: d.update(w=10**400), "frame 0 cannot be understood"),
        (lambda d: d.update(w=320.5), "w and h are 320.5 and 240, expected whole pixels"),
        (lambda d: d.update(w=True), "w is True, expected a number"),
        (lambda d: d.update(fl_x=10**400), "frame 0 cannot be understood"),
        (lambda d: d["frames"][0]["transform_matrix"][0].__setitem__(3, 10**400), "frame 0 cannot be understood"),
        (lambda d: d["frames"][0].update(file_path=7), "file_path is no text"),
        (lambda d: d["frames"][0].update(file_path="\ud800.png"), "file_path is no text"),
        (lambda d: d.update(k4=0.1), "k4 is not supported; undistort the pictures first"),
        (lambda d: d.update(is_fisheye=True), "camera_model a fisheye is not supported"),
        (lambda d: d["frames"][3].update(time=math.nan), "time is nan"),
        (lambda d: d["frames"][3].update(time="noon"), "frame 3 cannot be understood"),
        (lambda d: d["frames"][3].pop("time"), 'only 8 of 9 frames have a "time"'),
        (lambda d: d["frames"][3].update(time=0.5), '"time" of frames/000003.png and frames/000004.png is the same'),
        (lambda d: d["frames"][0].update(file_path="../../secret.png"), "lies outside"),
        (
            lambda d: d["frames"][0]["transform_matrix"].__setitem__(3, [0, 0, 0, 2]),
            "of frames/000000.png is not a rot",
        ),
        (lambda d: d["frames"][0].update(transform_matrix=SHEARED), "of frames/000000.png is not a rotation"),
        (lambda d: d["frames"][1].update(file_path="./frames/000000.png"), "picture frames/000000.png twice"),
        (lambda d: d.update(fl_x=-5.0), "frame 0: the focal length (fl_x, fl_y) is -5"),
        (lambda d: d.update(fl_x=float("nan")), "the focal length (fl_x, fl_y) is nan"),
        (lambda d: d.update(fl_y=1e20), "expected 3.2 to 320000 pixels for pictures of 320x240"),
        (lambda d: d.update(cx=1e9), "the principal point (cx, cy) is 1e+09, 120, far outside"),
        (lambda d: d.update(w=0), "width and height (w, h) are 0x240"),
        (lambda d: d.update(camera_model="OPENCV", k1=-1e6), "no lens distorts like that"),
        (lambda d: d.update(camera_model="OPENCV", k1=float("nan")), "no lens distorts like that"),
        (lambda d: [f.update(file_path="x/" + f["file_path"]) for f in d["frames"]], "holds none of the 9 pictures"),
    ],
)
def test_damaged_transforms_are_refused(tmp_path: Path, change: Callable[[Any], object], says: str) -> None:
    source = given(tmp_path / "given", with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    (source / "capture.json").unlink()  # whose times would hold
    change(document)
    (source / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"transforms\.json|given") as refusal:
        open_source(source, Selection(), None)
    assert says in str(refusal.value)


def foreign(folder: Path, change: Callable[[Any], object], name: str = "transforms.json") -> Source:
    """A nerfstudio folder that another program made; `change` edits the cameras."""
    source = given(folder, with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    for file in ("capture.json", "transforms.json"):
        (source / file).unlink()
    change(document)
    (source / name).write_text(json.dumps(document))
    return open_source(source, Selection(), None)


def test_times_of_transforms_are_those_of_its_frames(tmp_path: Path) -> None:
    """Reversed, and with a gap: only order and spacing have a meaning."""
    seconds = [0, 1, 2, 3, 4, 12, 13, 14, 16]
    opened = foreign(
        tmp_path / "given", lambda d: [f.update(time=-3.5 * s) for f, s in zip(d["frames"], seconds, strict=True)]
    )
    pictures = list(opened.pictures)
    assert [p.label for p in pictures] == [f"frames/{i:06}.png" for i in reversed(range(9))]
    assert [p.number for p in pictures] == list(reversed(range(9)))
    mean_step = 16 / 8
    expected = [(16 - s) / mean_step / 30 for s in reversed(seconds)]
    assert [p.time_s for p in pictures] == pytest.approx(expected)
    assert opened.times_s() == pytest.approx(expected)
    assert any("30 frames a second are taken for the mean (--fps)" in note for note in opened.notes)


def test_times_that_are_all_the_same_say_nothing(tmp_path: Path) -> None:
    opened = foreign(tmp_path / "given", lambda d: [f.update(time=0) for f in d["frames"]])
    assert opened.times_s() == pytest.approx(np.arange(9) / 30)
    assert any('"time" is the same for all frames' in note for note in opened.notes)


def test_distortion_is_kept_to_its_last_coefficient(tmp_path: Path) -> None:
    """Whatever the camera's kind is called. OpenCV's formula at one ray, by hand."""
    lens = {"k1": -0.2, "k2": 0.05, "p1": 0.01, "p2": -0.02, "k3": 0.3}
    opened = foreign(tmp_path / "given", lambda d: d.update(camera_model="PINHOLE", **lens))
    assert opened.posed is not None
    camera = next(iter(opened.posed.model.cameras.values()))
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    radial = 1 - 0.2 * r2 + 0.05 * r2**2 + 0.3 * r2**3
    u = x * radial + 2 * 0.01 * x * y - 0.02 * (r2 + 2 * x * x)
    v = y * radial + 0.01 * (r2 + 2 * y * y) - 2 * 0.02 * x * y
    fx, fy, cx, cy = camera.params[:4]
    assert camera.img_from_cam(np.array([x, y, 1.0])) == pytest.approx([fx * u + cx, fy * v + cy])


def test_keys_that_are_not_read_are_named(tmp_path: Path) -> None:
    opened = foreign(tmp_path / "given", lambda d: d["frames"][2].update(mask_path="m.png", colmap_im_id=4))
    unread = "mask_path, ply_file_path, test_filenames, train_filenames, val_filenames"
    assert f"not used of transforms.json: {unread}" in opened.notes


def test_d_nerf_names_its_pictures_without_ending_and_their_size_not_at_all(tmp_path: Path) -> None:
    def change(document: Any) -> None:
        for key in ("w", "h", "cx", "cy", "fl_x", "fl_y", "camera_model", "k1", "k2", "p1", "p2"):
            document.pop(key)
        document["camera_angle_x"] = 2 * math.atan(0.5)
        for frame in document["frames"]:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")

    opened = foreign(tmp_path / "given", change, "transforms_train.json")
    assert [p.label for p in opened.pictures] == [f"frames/{i:06}.png" for i in range(9)]
    assert opened.posed is not None
    camera = next(iter(opened.posed.model.cameras.values()))
    assert (camera.width, camera.height) == (320, 240)
    assert list(camera.params) == pytest.approx([320, 320, 160, 120])


def test_of_several_colmap_models_the_largest_is_taken_and_named(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    (source / "sparse/0").rename(source / "sparse/10")
    (source / "sparse/0").mkdir()
    for name in ("cameras.txt", "points3D.txt"):
        (source / "sparse/0" / name).write_bytes((source / "sparse/10" / name).read_bytes())
    images = (source / "sparse/10/images.txt").read_text().splitlines(keepends=True)
    (source / "sparse/0/images.txt").write_text("".join(images[:8]))
    (source / "sparse/2").mkdir()
    for name in ("cameras.txt", "images.txt", "points3D.txt"):
        (source / "sparse/2" / name).write_text("1 nonsense\n")
    opened = open_source(source, Selection(), None)
    assert opened.posed is not None
    assert opened.posed.model.num_reg_images() == 9
    assert any(
        n.startswith("of 2 models the largest is used: ") and "10 (9 frames); not 0 (4)" in n for n in opened.notes
    )
    assert any(n.startswith("not used: ") and "sparse/2" in n for n in opened.notes)


def photograph(path: Path, taken: str | None) -> None:
    exif = Image.Exif()
    if taken is not None:
        exif.get_ifd(0x8769)[0x9003] = taken
    Image.new("RGB", (64, 48), (90, 120, 60)).save(path, exif=exif)


def test_a_counter_that_begins_anew_is_put_in_order_by_exif(tmp_path: Path) -> None:
    """DJI counts to 0999 and goes on with 0001; two photographs may be of one second."""
    names = ["0997", "0998", "0999", "0001", "0002"]
    for name, second in zip(names, ("10", "12", "14", "14", "16"), strict=True):
        photograph(tmp_path / f"DJI_{name}.jpg", f"2024:06:01 12:00:{second}")
    opened = open_source(tmp_path, Selection(), None)
    assert [p.label for p in opened.pictures] == [f"DJI_{name}.jpg" for name in names]
    assert opened.times_s() == pytest.approx([0, 2, 4, 4.5, 6])
    assert any("begins anew" in note for note in opened.notes)
    stated = open_source(tmp_path, Selection(source_fps=2), None)
    assert [p.label for p in stated.pictures] == [f"DJI_{name}.jpg" for name in names]
    assert stated.times_s() == pytest.approx([0, 0.5, 1, 1.5, 2])


def test_names_without_exif_keep_their_order_and_their_gaps(tmp_path: Path) -> None:
    for number in (3, 4, 7):
        photograph(tmp_path / f"{number}.jpg", "2024:06:01 12:00:00" if number == 3 else None)
    opened = open_source(tmp_path, Selection(source_fps=10), None)
    assert opened.times_s() == pytest.approx([0, 0.1, 0.4])
    assert opened.notes == []


def test_a_damaged_colmap_model_is_refused(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    (source / "sparse/0/cameras.txt").write_text("1 PINHOLE nonsense\n")
    with pytest.raises(InputError, match=r"cannot be read as a COLMAP model|holds no image"):
        open_source(source, Selection(), None)


def test_a_colmap_model_cut_short_anywhere_is_told_before_colmap_reads_it(tmp_path: Path) -> None:
    """COLMAP would take the bytes that are not there for counts."""
    model = pycolmap.synthesize_dataset(
        pycolmap.SyntheticDatasetOptions(num_rigs=1, num_cameras_per_rig=2, num_frames_per_rig=3, num_points3D=20)
    )
    model.write(tmp_path)
    assert damaged(tmp_path) is None
    for path in sorted(tmp_path.glob("*.bin")):
        whole = path.read_bytes()
        for left in {0, 4, *range(8, len(whole), max(len(whole) // 23, 1)), len(whole) - 1}:
            path.write_bytes(whole[:left])
            assert damaged(tmp_path) == path.name, left
        path.write_bytes(whole)
    cameras = tmp_path / "cameras.bin"
    cameras.write_bytes(cameras.read_bytes().replace(b"\x00" * 4, b"\xff" * 4, 1))  # more than there can be
    assert damaged(tmp_path) == "cameras.bin"


def test_an_empty_file_of_a_colmap_model_is_refused_before_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "sparse/0").mkdir(parents=True)
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        (tmp_path / "sparse/0" / name).touch()
    photograph(tmp_path / "1.jpg", None)
    with pytest.raises(InputError, match=r"sparse/0: cameras\.bin is cut short or damaged; export it again"):
        open_source(tmp_path, Selection(), None)


def edited(folder: Path, file: str, old: str, new: str) -> None:
    """The first match of `old` in a text file of a COLMAP model, replaced."""
    path = folder / "sparse/0" / file
    text, count = re.subn(old, new, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)


CAMERA = r"1 PINHOLE 320 240 .*"


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("images.txt", r"^1 \S+ \S+ \S+ \S+", "1 0 0 0 0", "sparse/0: the pose of 000000.png is not a rotation"),
        (
            "images.txt",
            r"^1 \S+ \S+ \S+ \S+",
            "1 1e200 1e200 0 0",
            "sparse/0: the pose of 000000.png is not a rotation",
        ),
        ("images.txt", "000001.png", "000000.png", "names the picture 000000.png twice"),
        ("cameras.txt", CAMERA, "1 PINHOLE 320 240 0 0 160 120", r"camera 1: the focal length \(fl_x, fl_y\) is 0, 0"),
        ("cameras.txt", CAMERA, "1 PINHOLE -320 -240 300 300 160 120", "camera 1: width and height"),
        ("cameras.txt", CAMERA, "1 PINHOLE 320 240 300 300 1e9 120", "camera 1: the principal point"),
        ("cameras.txt", CAMERA, "1 SIMPLE_RADIAL 320 240 300 160 120 -5000", "camera 1: no lens distorts like that"),
    ],
)
def test_unusable_colmap_models_are_refused(tmp_path: Path, file: str, old: str, new: str, says: str) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    edited(source, file, old, new)
    with pytest.raises(InputError, match=says):
        open_source(source, Selection(), None)


def test_strong_lenses_are_not_refused() -> None:
    import pycolmap

    for model, params in (
        ("OPENCV", [500.0, 505, 330, 228, -0.3, 0.12, 0.001, -0.002]),
        ("OPENCV_FISHEYE", [300.0, 300, 320, 240, 0.05, -0.01, 0.0, 0.0]),
        ("SIMPLE_RADIAL", [2500.0, 320, 240, 0.4]),
    ):
        check_intrinsics(pycolmap.Camera(model=model, width=640, height=480, params=params), "x")


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_colmap_model_that_lacks_a_file_is_told_so(tmp_path: Path, name: str) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    (source / "sparse/0" / name).unlink()
    with pytest.raises(InputError, match=f"sparse/0: a COLMAP model without {name}; export it again"):
        open_source(source, Selection(), None)


@pytest.mark.parametrize("is_colmap", [True, False])
def test_a_camera_of_another_shape_than_the_pictures_is_refused(tmp_path: Path, is_colmap: bool) -> None:
    source = given(tmp_path / "given", with_points=True)
    if is_colmap:
        (source / "transforms.json").unlink()
        edited(source, "cameras.txt", "320 240", "240 320")
    else:
        document = json.loads((source / "transforms.json").read_text())
        (source / "transforms.json").write_text(json.dumps(document | {"w": 240, "h": 320}))
    with pytest.raises(InputError, match=r"camera is 240x320, which is not the shape of the pictures, 320x240"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)
    assert not (tmp_path / "capture").exists()


def test_sizes_of_one_picture() -> None:
    assert same_shape((240, 126), (1024, 540))
    assert same_shape((1024, 540), (240, 127))
    assert same_shape((3840, 2160), (960, 540))
    assert not same_shape((1024, 540), (1024, 576))
    assert not same_shape((640, 480), (480, 640))


def test_a_camera_that_lies_too_far_away_is_named(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    for frame in document["frames"]:
        frame["transform_matrix"][0][3] += 2e4  # a map's coordinates
    (source / "transforms.json").write_text(json.dumps(document))
    says = r"given: the camera of frames/00000\d.png would lie 2e\+04 from the origin .*, over 10000; "
    with pytest.raises(InputError, match=says):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)


def test_two_cameras_and_points_without_tracks(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    edited(source, "cameras.txt", "\n", "\n2 PINHOLE 320 240 400 400 160 120\n")
    edited(source, "images.txt", "1 000003.png", "2 000003.png")
    with pytest.raises(InputError, match=r"sparse/0: its frames have 2 cameras, and no points that tell which frames"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)

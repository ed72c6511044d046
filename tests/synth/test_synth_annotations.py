"""Exports, each read back by the program that its users have."""

import json
from pathlib import Path

import numpy as np
import pytest

from synth.camera import invert_rigid
from synth.export.coco import run_lengths
from synth.truth.recording import Recording


@pytest.fixture(scope="module")
def recording(full_capture: Path) -> Recording:
    return Recording(full_capture)


def test_evo_reads_the_trajectory(recording: Recording) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    trajectory = file_interface.read_tum_trajectory_file(str(recording.root / "poses.tum"))
    assert trajectory.check()[0]
    np.testing.assert_allclose(trajectory.timestamps, recording.tracks["time_s"])
    for k, pose in enumerate(trajectory.poses_se3):
        np.testing.assert_allclose(pose, invert_rigid(recording.viewmats[k]), atol=1e-9)


def test_pycocotools_reads_boxes_and_masks(recording: Recording) -> None:
    coco_module = pytest.importorskip("pycocotools.coco")
    coco = coco_module.COCO(str(recording.root / "coco.json"))
    assert len(coco.getImgIds()) == recording.count
    checked = 0
    for annotation in coco.loadAnns(coco.getAnnIds()):
        ids = recording.truth(annotation["image_id"] - 1)["instance_id"]
        mask = coco.annToMask(annotation).astype(bool)
        np.testing.assert_array_equal(mask, ids == annotation["track_id"])
        rows, columns = np.nonzero(mask)
        left, top, width, height = annotation["bbox"]
        assert (left, top) == (columns.min(), rows.min())
        assert (width, height) == (np.ptp(columns) + 1, np.ptp(rows) + 1)
        checked += 1
    assert checked > 20
    names = {c["id"]: c["name"] for c in coco.loadCats(coco.getCatIds())}
    classes = {i["id"]: i["class"] for i in recording.index["instances"]}
    assert all(names[a["category_id"]] == classes[a["track_id"]] for a in coco.loadAnns(coco.getAnnIds()))


def test_run_lengths_decode_to_the_mask() -> None:
    decode = pytest.importorskip("pycocotools.mask")
    rng = np.random.default_rng(0)
    masks = [rng.random((7, 5)) < 0.5, np.zeros((3, 4), bool), np.ones((3, 4), bool)]
    for mask in masks:
        encoded = run_lengths(mask)
        packed = decode.frPyObjects(encoded, *mask.shape)
        np.testing.assert_array_equal(decode.decode(packed).astype(bool), mask)


def test_mot_tables_have_their_columns(recording: Recording) -> None:
    visdrone = np.loadtxt(recording.root / "mot" / "visdrone.txt", delimiter=",", dtype=int)
    uavdt = np.loadtxt(recording.root / "mot" / "uavdt.txt", delimiter=",", dtype=int)
    assert (visdrone.shape[1], uavdt.shape[1]) == (10, 9)
    assert set(visdrone[:, 0]) == set(range(1, recording.count + 1))
    assert set(visdrone[:, 7]) <= {1, 3, 4, 5, 6, 9, 10}
    assert set(visdrone[:, 8]) <= {0, 1}
    assert set(visdrone[:, 9]) <= {0, 1, 2}
    assert set(uavdt[:, 8]) <= {1, 2, 3}
    annotations = json.loads((recording.root / "coco.json").read_text())["annotations"]
    boxes = {(a["image_id"], a["track_id"]): a["bbox"] for a in annotations}
    assert {(row[0], row[1]): row[2:6].tolist() for row in visdrone} == boxes


def test_class_ids_name_what_is_there(recording: Recording) -> None:
    names = np.array(recording.index["classes"])
    classes = {i["id"]: i["class"] for i in recording.index["instances"]}
    truth = recording.truth(2)
    shown = names[truth["class_id"]]
    for number in np.unique(truth["instance_id"][truth["instance_id"] > 0]):
        assert set(shown[truth["instance_id"] == number]) == {classes[int(number)]}
    height = recording.view(2).surface(truth["depth_z"])[..., 2]
    assert (shown == "road").mean() > 0.1
    assert np.abs(height[shown == "road"]).max() < 0.2
    assert height[shown == "building"].max() > 3.0

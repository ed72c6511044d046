"""The capture reader accepts what docs/formats.md describes and refuses the rest in one sentence."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData, PlyElement

from aa4d.capture.reader import read_capture, read_image, read_images
from aa4d.capture.truth import boxes_of, moving_mask
from aa4d.errors import InputError


def edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    document = json.loads((folder / "capture.json").read_text())
    change(document)
    (folder / "capture.json").write_text(json.dumps(document))


def test_reads_frames_points_splits_and_truth(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    assert len(capture.frames) == 10
    assert capture.of_split("test") == [0, 8]
    assert capture.points.shape == (27 * 17, 3)
    assert read_images(capture, [0, 1]).shape == (2, 32, 48, 3)
    mask = moving_mask(capture, 5)
    assert mask is not None
    # A square of 3 m at 2 px a metre.
    assert 30 <= mask.sum() <= 42


def test_moving_pixels_are_those_of_instances_that_move_at_that_frame(toy_capture: Path) -> None:
    tracks = dict(np.load(toy_capture / "truth/tracks.npz"))
    tracks["moving"][5] = False
    np.savez(toy_capture / "truth/tracks.npz", **tracks)
    capture = read_capture(toy_capture)
    at_rest, moving = moving_mask(capture, 5), moving_mask(capture, 6)
    assert at_rest is not None
    assert moving is not None
    assert at_rest.sum() == 0
    assert moving.sum() > 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["frames"][3].pop("viewmat"), "frame '000003' has no pose"),
        (lambda d: d["frames"][3]["viewmat"][0].__setitem__(3, math.nan), "viewmat of frame '000003' holds NaN"),
        (lambda d: d["frames"][3]["viewmat"][0].__setitem__(0, 2.0), "not a rotation"),
        (lambda d: d["frames"][3].update(viewmat=[[1, 2], [3, 4]]), "shape"),
        (lambda d: d["frames"][3]["viewmat"][0].__setitem__(3, 5e5), "local origin"),
        (lambda d: d["frames"][3].update(image="../../secret.png"), "leaves the capture folder"),
        (lambda d: d["frames"][3].update(image="/etc/passwd"), "leaves the capture folder"),
        (lambda d: d["frames"][3].update(split="validation"), 'expected "train" or "test"'),
        (lambda d: d["frames"][3].update(t=0.0), "does not follow"),
        (lambda d: d["frames"][-1].update(time_s=1e300), "over 1e+11 seconds"),
        (lambda d: d["frames"][3].update(time_s=0.1), "time_s of frame '000003' does not follow"),
        (lambda d: d["frames"][3].update(t=math.inf), "finite number"),
        (lambda d: d["frames"][3].update(name="000002"), "duplicate frame name"),
        (lambda d: d["frames"].clear(), '"frames" is missing or empty'),
        (lambda d: [f.update(split="test") for f in d["frames"]], "no training frame"),
        (lambda d: d.update(version=2), "update aa4d"),
        (lambda d: d.update(format="zip"), "aa4d-capture"),
        (lambda d: d.update(fps=0), "(0, 1000]"),
        (lambda d: d.update(fps=1001), "(0, 1000]"),
        (lambda d: d.update(fps=10**400), "finite number"),
        (lambda d: d["camera"].update(width=True), "positive integers"),
        (lambda d: d["frames"][3].update(name="\ud800"), "no plain file name"),
        (lambda d: d["frames"][3]["viewmat"][0].__setitem__(3, 10**400), "not a 4x4 matrix"),
        (lambda d: d["camera"].update(model="FISHEYE"), "FISHEYE"),
        (lambda d: d["camera"].update(distortion={"k1": 0.1}), "camera has the key 'distortion'"),
        (lambda d: d["camera"].update(k1=0.1), "camera has the key 'k1', which a PINHOLE does not know"),
        (lambda d: d["camera"].update(width=-3), "positive integers"),
        (lambda d: d["camera"]["K"][0].__setitem__(0, 0), "focal length"),
        (lambda d: d["camera"]["K"][0].__setitem__(1, 3.0), "skew"),
        (lambda d: d["camera"]["K"][0].__setitem__(0, 1e300), "over 1e+06 pixels"),
        (lambda d: d["camera"].update(width=10**9), "over 16384 pixels"),
        (lambda d: d["frames"][3].update(name="x" * 300), "longer than 200 bytes"),
        (lambda d: d.pop("points"), "points is missing"),
    ],
)
def test_malformed_index_is_refused_with_file_and_key(
    toy_capture: Path, change: Callable[[dict[str, Any]], None], says: str
) -> None:
    edit(toy_capture, change)
    with pytest.raises(InputError, match=r"capture\.json") as refusal:
        read_capture(toy_capture)
    assert says in str(refusal.value)


def test_missing_image_is_named(toy_capture: Path) -> None:
    (toy_capture / "frames/000004.png").unlink()
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match=r"000004.png: image of frame '000004' is missing"):
        read_image(capture, capture.frames[4])


def test_truncated_image_is_named(toy_capture: Path) -> None:
    path = toy_capture / "frames/000004.png"
    path.write_bytes(path.read_bytes()[:200])
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match=r"000004.png: .* cannot be read"):
        read_image(capture, capture.frames[4])


def test_image_of_another_size_is_named(toy_capture: Path) -> None:
    Image.new("RGB", (10, 10)).save(toy_capture / "frames/000004.png")
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match="image is 10x10, but the capture's camera says 48x32"):
        read_image(capture, capture.frames[4])


@pytest.mark.parametrize("shape", [(32, 48), (32, 48, 3), (32, 48, 4)])
def test_an_image_of_sixteen_bits_is_refused_rather_than_cut_off(toy_capture: Path, shape: tuple[int, ...]) -> None:
    pixels = np.full(shape, 30_000, np.uint16)
    pixels[..., 3:] = 65_535
    cv2.imwrite(str(toy_capture / "frames/000004.png"), pixels)
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match=r"000004.png: .* expected 8 bits a channel"):
        read_image(capture, capture.frames[4])


def test_a_transparent_image_is_refused_and_one_with_an_idle_alpha_is_read(toy_capture: Path) -> None:
    pixels = np.full((32, 48, 4), [10, 20, 30, 255], np.uint8)
    capture = read_capture(toy_capture)
    Image.fromarray(pixels).save(toy_capture / "frames/000004.png")
    assert (read_image(capture, capture.frames[4]) == [10, 20, 30]).all()
    pixels[3, 4, 3] = 254
    Image.fromarray(pixels).save(toy_capture / "frames/000004.png")
    with pytest.raises(InputError, match=r"000004.png: .* transparent in places"):
        read_image(capture, capture.frames[4])


@pytest.mark.parametrize("kind", ["f4", "f8", "u2", "i1", "i4"])
def test_colors_of_points_that_are_no_bytes_are_refused(toy_capture: Path, kind: str) -> None:
    """Floats from 0 to 1 would become black, and 16 bits would wrap."""
    vertex = PlyData.read(str(toy_capture / "points.ply"))["vertex"].data
    colors = [(name, kind) for name in ("red", "green", "blue")]
    other = vertex.astype([(name, "f4") for name in "xyz"] + colors)
    PlyData([PlyElement.describe(other, "vertex")]).write(str(toy_capture / "points.ply"))
    with pytest.raises(InputError, match=r"points\.ply: colors are \w+, expected bytes"):
        read_capture(toy_capture)


def test_damaged_truth_is_named(toy_capture: Path) -> None:
    path = toy_capture / "truth/000004.npz"
    path.write_bytes(path.read_bytes()[:100])
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match=r"000004.npz"):
        moving_mask(capture, 4)


def test_pickled_truth_is_refused(toy_capture: Path) -> None:
    np.savez(toy_capture / "truth/000004.npz", instance_id=np.array([{"code": 1}], dtype=object))
    capture = read_capture(toy_capture)
    with pytest.raises(InputError, match=r"000004.npz"):
        moving_mask(capture, 4)


@pytest.mark.parametrize("content", [b"", b"ply\nformat ascii 1.0\nelement vertex 9\n", b"\x00" * 64])
def test_damaged_point_cloud_is_named(toy_capture: Path, content: bytes) -> None:
    (toy_capture / "points.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"points\.ply"):
        read_capture(toy_capture)


def test_a_folder_that_is_no_capture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such capture folder"):
        read_capture(tmp_path / "absent")
    with pytest.raises(InputError, match=r"no capture\.json"):
        read_capture(tmp_path)


def store_boxes(folder: Path, **changed: np.ndarray) -> None:
    arrays: dict[str, np.ndarray] = {
        "frame": np.array([1, 1]),
        "target": np.array([4, -1]),
        "box_px": np.array([[1.0, 2, 10, 12], [0, 0, 5.5, 4]]),
        "category": np.array(["car", ""]),
    }
    (folder / "movers").mkdir(exist_ok=True)
    np.savez(folder / "movers/boxes.npz", **(arrays | changed))


def test_boxes_are_read_and_a_capture_without_them_has_none(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    assert boxes_of(capture) is None
    store_boxes(toy_capture)
    boxes = boxes_of(capture)
    assert boxes is not None
    assert (boxes.target.tolist(), boxes.category.tolist()) == ([4, -1], ["car", ""])
    assert np.array_equal(boxes.box_px, np.array([[1, 2, 10, 12], [0, 0, 5.5, 4]]))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"frame": np.array([1, 99])}, "box 1 is of frame 99, and there are"),
        ({"target": np.array([4])}, "array 'target' is int64 of shape \\(1,\\), expected shape \\(2,\\)"),
        ({"box_px": np.array([[1.0, 2, 10, 12], [5, 0, 5, 4]])}, "box 1 is no rectangle in the frame"),
        ({"box_px": np.array([[1.0, 2, 10, np.nan], [0, 0, 5, 4]])}, "box 0 is no rectangle in the frame"),
        ({"box_px": np.array([[1.0, 2, 10, 12], [0, 0, 5, 4000]])}, "box 1 is no rectangle in the frame"),
        ({"category": np.array([{}, {}], object)}, "array 'category' cannot be read"),
    ],
)
def test_boxes_of_another_kind_are_refused(toy_capture: Path, changed: dict[str, np.ndarray], says: str) -> None:
    store_boxes(toy_capture, **changed)
    with pytest.raises(InputError, match=says):
        boxes_of(read_capture(toy_capture))


def test_a_number_that_is_none_in_a_key_that_nobody_reads_is_refused(toy_capture: Path) -> None:
    """JSON's 1e999 is infinite: no identity can be made of it."""
    index = toy_capture / "capture.json"
    index.write_text(index.read_text().replace('"version": 1', '"version": 1, "note": 1e999'))
    with pytest.raises(InputError, match=r"capture\.json: holds what is no JSON"):
        read_capture(toy_capture)

"""Folders with a COLMAP model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from aa4d.capture.colmap_files import damaged
from aa4d.capture.make import make_capture
from aa4d.capture.reader import read_capture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import open_source
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.given import SETTINGS, edited, given, photograph, silent


def test_a_colmap_model_is_levelled_and_its_frames_stay_as_they_are(tmp_path: Path) -> None:
    """A model that stands askew, with points and their tracks: as COLMAP leaves it."""

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


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_colmap_model_that_lacks_a_file_is_told_so(tmp_path: Path, name: str) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    (source / "sparse/0" / name).unlink()
    with pytest.raises(InputError, match=f"sparse/0: a COLMAP model without {name}; export it again"):
        open_source(source, Selection(), None)


def test_two_cameras_and_points_without_tracks(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=True)
    (source / "transforms.json").unlink()
    edited(source, "cameras.txt", "\n", "\n2 PINHOLE 320 240 400 400 160 120\n")
    edited(source, "images.txt", "1 000003.png", "2 000003.png")
    with pytest.raises(InputError, match=r"sparse/0: its frames have 2 cameras, and no points that tell which frames"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)

"""`aa4d capture` on a small flight with true cameras: from frames to a capture that training reads."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.capture.selfcheck import check_capture
from aa4d.capture.settings import PRESETS
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.truth import moving_mask
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.making import SETTINGS, make, pose_errors


def test_cameras_are_those_of_the_flight(made: CaptureSummary) -> None:
    assert made.frames == made.used == 9
    distance_m, angle_deg = pose_errors(made.folder, aerial.arc())
    # 40 m up, a pixel is 13 cm wide; what a wrong principal point or focal length costs is far more.
    assert distance_m < 0.15
    assert angle_deg < 0.3
    assert made.reprojection_px < 0.5


def test_the_capture_is_what_training_reads(made: CaptureSummary) -> None:
    capture = read_capture(made.folder)
    assert capture.of_split("test") == [0, 8]
    assert [f.t for f in capture.frames] == pytest.approx(np.linspace(0, 1, 9))
    assert capture.fps == pytest.approx(10)
    assert len(capture.points) > 200
    with Image.open(made.folder / capture.frames[3].image) as image:
        assert image.size == (capture.camera.width, capture.camera.height)
    document = json.loads((made.folder / "capture.json").read_text())
    assert document["generator"]["world"]["unit"] == "unit"
    assert document["frames"][3]["source"] == "frame_0003.png"


def test_the_world_is_level_and_its_unit_is_the_viewing_distance(made: CaptureSummary) -> None:
    capture = read_capture(made.folder)
    centres = np.array([-f.viewmat[:3, :3].T @ f.viewmat[:3, 3] for f in capture.frames])
    assert (centres[:, 2] > 0.7).all()
    assert (centres[:, 2] < 1.3).all()
    ground = np.abs(capture.points[:, 2]) < 0.03
    assert ground.mean() > 0.5
    assert capture.points[:, 2].max() > 0.08  # roofs are 4 to 9 m, the camera 40 m above the ground
    depths = np.concatenate([capture.points @ f.viewmat[2, :3] + f.viewmat[2, 3] for f in capture.frames])
    assert np.median(depths) == pytest.approx(1, abs=0.02)


def test_other_programs_cameras_are_the_same(made: CaptureSummary) -> None:

    capture = read_capture(made.folder)
    model = pycolmap.Reconstruction(made.folder / "sparse/0")
    transforms = json.loads((made.folder / "transforms.json").read_text())
    assert model.num_reg_images() == len(transforms["frames"]) == 9
    for frame, entry in zip(capture.frames, transforms["frames"], strict=True):
        image = model.find_image_with_name(f"{frame.name}.png")
        assert np.allclose(image.cam_from_world().matrix(), frame.viewmat[:3], atol=1e-9)
        opengl = np.linalg.inv(np.array(entry["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
        assert np.allclose(opengl, frame.viewmat, atol=1e-9)
        assert entry["time"] == frame.t
        assert entry["file_path"] in transforms[f"{frame.split}_filenames"]
        seen = image.get_observation_points2D()
        assert len(seen) > 50
        xyz = np.array([model.point3D(p.point3D_id).xyz for p in seen]) @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
        found = (xyz / xyz[:, 2:]) @ capture.camera.K.T
        assert np.median(np.linalg.norm(found[:, :2] - [p.xy for p in seen], axis=1)) < 1
    assert all(point.track.length() >= 3 for point in model.points3D.values())


def test_an_altitude_gives_the_scale(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    shutil.copytree(made.folder, tmp_path / "copy")
    scaled = make(flight, tmp_path / "copy", replace(SETTINGS, altitude_m=42.0))
    assert scaled.world.unit == "metres"
    capture = read_capture(scaled.folder)
    depths = np.concatenate([capture.points @ f.viewmat[2, :3] + f.viewmat[2, 3] for f in capture.frames])
    assert np.median(depths) == pytest.approx(42, rel=0.02)


def test_the_accurate_preset_sees_more(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    settings = replace(SETTINGS, preset="accurate", reconstruction=PRESETS["accurate"])
    accurate = make(flight, tmp_path / "capture", settings)
    assert accurate.frames == 9
    assert accurate.points > 1.2 * made.points
    assert pose_errors(accurate.folder, aerial.arc())[0] < 0.15


def test_the_self_check_counts_in_pixels_of_what_was_reconstructed_from(made: CaptureSummary) -> None:
    """Two pixels of the capture are little in frames that it has at their full size, and much at half of it."""
    capture = read_capture(made.folder)
    frame = capture.frames[4]
    in_camera = capture.points @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
    pixels = (in_camera / in_camera[:, 2:]) @ capture.camera.K.T
    seen = {frame.name: (capture.points, pixels[:, :2] + [2.0, 0.0])}
    assert check_capture(made.folder, seen, 1.0).reprojection_px.median == pytest.approx(2, abs=1e-3)
    size = f"{capture.camera.width}x{capture.camera.height}"
    with pytest.raises(InputError, match=rf"self-check failed \(reprojection error 2\.0 px in frames of {size}"):
        check_capture(made.folder, seen, 0.5)
    with pytest.raises(InputError, match="no frame shows any point"):
        check_capture(made.folder, {}, 1.0)


@pytest.mark.parametrize("movers", ["auto", "twice"])
def test_movers_are_masked_and_scored_apart(tmp_path: Path, movers: str) -> None:
    truth = aerial.arc()
    fixed = aerial.town()

    def surfaces(i: int) -> list[aerial.Surface]:
        # A car of 4 m drives across the flight's direction, 1.6 m a frame.
        car = aerial.Surface((-4.0, -11 + 1.6 * i), 2.0, 0.1, aerial.texture(77, 60))
        return [fixed[0], car, *fixed[1:]]

    source = aerial.write(tmp_path / "frames", aerial.pictures(truth, surfaces))
    made = make(source, tmp_path / "capture", replace(SETTINGS, movers=movers))
    capture = read_capture(made.folder)
    recalls, shares = [], []
    for i in range(1, 8):
        mask = moving_mask(capture, i)
        assert mask is not None
        # Where the car's middle is, by the true camera; the capture's frames are nearly the source's.
        centre = truth[i] @ [-4.0, -11 + 1.6 * i, 0.1, 1]
        x, y = (aerial.K @ (centre[:3] / centre[2]))[:2]
        scale = capture.camera.width / aerial.WIDTH
        column, row = int(x * scale), int(y * scale)
        if 8 < column < mask.shape[1] - 8 and 8 < row < mask.shape[0] - 8:
            recalls.append(bool(mask[row, column]))
        shares.append(mask.mean())
    assert np.mean(recalls) > 0.7
    # The car covers 1.2 % of a frame.
    assert np.mean(shares) < 0.06

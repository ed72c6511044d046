"""Mapping over flat ground begins with the right one of two explanations."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from aa4d.capture.beginning import beginnings, explained, of_a_plane
from aa4d.capture.clip import Clip, ClipFrame
from aa4d.capture.mapping import reconstruct
from aa4d.capture.matching import Matches
from aa4d.capture.settings import PRESETS, CaptureSettings
from tests.capture.aerial import look

WIDTH, HEIGHT, FOCAL_PX = 640, 360, 500.0
K = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1.0]])
FRAMES = 12
FOV_DEG = 2 * np.degrees(np.arctan(0.5 * WIDTH / FOCAL_PX))


def ahead() -> list[np.ndarray]:
    """A drone that flies straight ahead, 30 m up, and looks ahead and a little down: it does not turn."""
    return [look(np.array([0, 2.5 * i, 30.0]), np.array([0, 2.5 * i + 60, 12.0])) for i in range(FRAMES)]


def street(above: int) -> np.ndarray:
    """Points of the ground, and some above it."""
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(-60, 60, 900), random.uniform(30, 250, 900), np.zeros(900)])
    points[:above, 2] = random.uniform(2, 15, above)
    return points


def pixels_of(viewmat: np.ndarray, points: np.ndarray) -> np.ndarray:
    seen = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    return (seen @ K.T)[:, :2] / seen[:, 2:]


def rays_of(viewmat: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.column_stack([pixels_of(viewmat, points), np.ones(len(points))]) @ np.linalg.inv(K).T


def test_what_stands_above_the_plane_tells_the_motion_from_its_double() -> None:
    one, other = ahead()[0], ahead()[8]
    noise = np.random.default_rng(1).normal(0, 0.3 / FOCAL_PX, (900, 2))
    rays = rays_of(one, street(150)), rays_of(other, street(150))
    rays[1][:, :2] += noise
    found = explained(*rays, 3 / FOCAL_PX)
    assert found is not None
    rotation, translation, times = found
    assert np.degrees(np.arccos((np.trace(rotation) - 1) / 2)) < 0.3
    moved = other[:3, :3] @ (-one[:3, :3].T @ one[:3, 3]) + other[:3, 3]  # of the first camera, in the second's frame
    assert translation @ moved / np.linalg.norm(moved) > 0.9995
    assert times > 2
    # On the plane alone both explain all.
    rays = rays_of(one, street(0)), rays_of(other, street(0))
    rays[1][:, :2] += noise
    found = explained(*rays, 3 / FOCAL_PX)
    assert found is not None
    assert found[2] < 1.1


@pytest.fixture(scope="module")
def matches(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, Matches]:
    """Frames of the flight, and what they have in common, as COLMAP verifies it."""
    folder, random = tmp_path_factory.mktemp("ahead"), np.random.default_rng(2)
    points, views = street(150), ahead()
    camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[0.8 * WIDTH, 320, 180, 0])
    names = [f"{i:06}.png" for i in range(FRAMES)]
    seen, pixels = [], []
    with pycolmap.Database.open(folder / "database.db") as stored:
        camera.camera_id = stored.write_camera(camera)
        for name, view in zip(names, views, strict=True):
            Image.new("RGB", (WIDTH, HEIGHT)).save(folder / name)
            at = pixels_of(view, points) + random.normal(0, 0.3, (len(points), 2))
            seen.append(np.flatnonzero(((at > 0) & (at < [WIDTH, HEIGHT])).all(axis=1)))
            pixels.append(at[seen[-1]])
            image = pycolmap.Image(name=name, camera_id=camera.camera_id)
            number = stored.write_image(image)
            stored.write_keypoints(number, pixels[-1].astype(np.float32))
        options = pycolmap.TwoViewGeometryOptions()
        options.ransac.random_seed = 0
        for i, j in combinations(range(FRAMES), 2):
            both, a, b = np.intersect1d(seen[i], seen[j], return_indices=True)
            pairs = np.column_stack([a, b]).astype(np.uint32)
            geometry = pycolmap.estimate_two_view_geometry(camera, pixels[i], camera, pixels[j], pairs, options)
            stored.write_matches(i + 1, j + 1, pairs)
            stored.write_two_view_geometry(i + 1, j + 1, geometry)
            assert len(both) > 100
    frames = tuple(ClipFrame(name, f"{0.1 * i:.1f} s", 0.1 * i, None, 1.0, None) for i, name in enumerate(names))
    return Clip(folder, WIDTH, HEIGHT, (WIDTH, HEIGHT), frames, ()), Matches(folder, 66, 66, {"PLANAR": 66}, ())


def test_a_flight_straight_ahead_over_flat_ground_does_not_turn(matches: tuple[Clip, Matches], tmp_path: Path) -> None:
    """From the pair that COLMAP chooses, eight of the frames are placed, turned against each other."""
    clip, matched = matches
    settings = CaptureSettings("fast", PRESETS["fast"], movers="off", fov_deg=FOV_DEG, threads=1)
    cameras = reconstruct(clip, matched, settings, tmp_path, lambda *_: None)
    assert len(cameras.registered) == FRAMES
    model = cameras.read()
    rotations = np.array([model.image(i).cam_from_world().rotation.matrix() for i in model.reg_image_ids()])
    traces = np.einsum("aij,bij->ab", rotations, rotations)
    assert np.degrees(np.arccos((traces.min() - 1) / 2)) < 1
    (note,) = [n for n in cameras.notes(clip) if "mapping began with" in n]
    assert note.startswith("most pairs of frames show one plane: mapping began with 0.")
    assert f"{FRAMES} frames, 0.3" in note
    assert note.endswith("px; used is the first")


def test_only_frames_of_the_part_that_is_mapped_are_begun_with(matches: tuple[Clip, Matches]) -> None:
    clip, matched = matches
    names = [frame.file for frame in clip.frames[2:9]]
    pair = of_a_plane(matched.database, names)
    assert pair is not None
    assert set(pair.files) <= set(names)
    assert beginnings(matched.database, names[:1]) == [None]
    # Of two frames that follow each other few points are seen under an angle.
    assert of_a_plane(matched.database, names[:2]) is None

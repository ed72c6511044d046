"""Satellite positions, the similarity to the world, undistortion, and steps that run once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from PIL import Image

from aa4d.capture.clip import Position
from aa4d.capture.gnss import east_north_up, position_of_photograph, read_subtitles
from aa4d.capture.matching import pairs
from aa4d.capture.orientation import (
    Similarity,
    find_world,
    kept_world,
    robust_similarity,
    umeyama,
    viewing_distance,
)
from aa4d.capture.undistortion import Undistortion, pinhole_boxes, pinhole_of, pinhole_pixels
from aa4d.capture.workspace import Progress, Step, StepResult, Workspace
from tests.capture import aerial

NEW = "[iso: 110] [latitude: 52.5{0}] [longitude: 13.4] [rel_alt: 30.{0} abs_alt: 91.2]"
MISSPELT = "[latitude : 52.5{0}] [longtitude : 13.4] [altitude: 30.{0}]"
OLD = "GPS(13.4,52.5{0},17) BAROMETER:30.{0}"
NEWER_OLD = "F/2.8, GPS (13.4, 52.5{0}, 12), D 24.90m, H 30.{0}m, H.S 0.00m/s"


@pytest.mark.parametrize("text", [NEW, MISSPELT, OLD, NEWER_OLD])
def test_positions_in_subtitles_of_dji_drones(tmp_path: Path, text: str) -> None:
    entries = [f"{n + 1}\n00:00:0{n},000 --> 00:00:0{n},900\n<font>{text.format(n)}</font>\n" for n in range(3)]
    (tmp_path / "DJI.SRT").write_text("\n".join(entries))
    track = read_subtitles(tmp_path / "DJI.SRT")
    assert track is not None
    at = track.at(1.5)
    assert at is not None
    assert at.latitude_deg == pytest.approx(52.515)
    assert at.longitude_deg == pytest.approx(13.4)
    assert at.altitude_m == pytest.approx(30.15)
    assert track.at(9.0) is None


@pytest.mark.parametrize("number", ["1e999", "-1e3", "9" * 400, "9" * 5000, "nan", "1.5.2"])
def test_what_is_no_number_in_subtitles_is_not_taken_for_a_part_of_it(tmp_path: Path, number: str) -> None:
    entry = "1\n{}:00:03,000 --> 00:00:05,000\n[latitude: {}] [longitude: {}] [altitude: {}]\n"
    path = tmp_path / "DJI.SRT"
    for values in ((number, "47.1", "8.5", "12.0"), ("00", number, "8.5", "12.0"), ("00", "47.1", number, "12.0")):
        path.write_text(entry.format(*values))
        assert read_subtitles(path) is None
    path.write_text(entry.format("00", "47.1", "8.5", number))
    track = read_subtitles(path)
    assert track is None or np.isfinite(track.values).all()


def test_subtitles_without_a_fix_give_no_positions(tmp_path: Path) -> None:
    (tmp_path / "a.srt").write_text("1\n00:00:00,000 --> 00:00:01,000\n[latitude: 0.0] [longitude: 0.0]\n")
    assert read_subtitles(tmp_path / "a.srt") is None
    (tmp_path / "b.srt").write_bytes(b"\xff\xfe\x00 nothing")
    assert read_subtitles(tmp_path / "b.srt") is None


def test_position_of_a_photograph(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x8825] = {1: "S", 2: (33.0, 30.0, 36.0), 3: "E", 4: (151.0, 12.0, 0.0), 5: b"\x00", 6: 81.5}
    Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg", exif=exif)
    position = position_of_photograph(tmp_path / "a.jpg")
    assert position is not None
    assert position.latitude_deg == pytest.approx(-33.51)
    assert position.longitude_deg == pytest.approx(151.2)
    assert position.altitude_m == pytest.approx(81.5)
    Image.new("RGB", (8, 8)).save(tmp_path / "b.jpg")
    assert position_of_photograph(tmp_path / "b.jpg") is None


def test_east_north_up_in_metres() -> None:
    origin = Position(50.0, 8.0, 100.0)
    places = [origin, Position(50.001, 8.0, 100.0), Position(50.0, 8.001, 100.0), Position(50.0, 8.0, 130.0)]
    enu = east_north_up(places, origin)
    # A degree of latitude is 111.23 km there, one of longitude 71.70 km.
    assert enu == pytest.approx(np.array([[0, 0, 0], [0, 111.23, 0], [71.70, 0, 0], [0, 0, 30]]), abs=0.02)


def scattered(seed: int) -> tuple[np.ndarray, Similarity]:
    generator = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    return generator.normal(size=(30, 3)), Similarity(37.0, rotation, np.array([1e4, -2e4, 300.0]))


def test_umeyama_finds_the_similarity() -> None:
    points, true = scattered(1)
    found = umeyama(points, true.of_points(points))
    assert found.scale == pytest.approx(true.scale)
    assert np.allclose(found.rotation, true.rotation)
    assert np.allclose(found.translation, true.translation)
    # A mirror image is no similarity: the rotation stays a rotation.
    mirrored = umeyama(points, points * np.array([1.0, 1, -1]))
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1)


def test_a_few_wild_positions_do_not_count() -> None:
    points, true = scattered(2)
    target = true.of_points(points) + np.random.default_rng(0).normal(size=(30, 3)) * 0.2
    target[:3] += 500.0
    found = robust_similarity(points, target)
    assert found.scale == pytest.approx(true.scale, rel=0.01)
    assert np.linalg.norm(found.of_points(points)[3:] - target[3:], axis=1).max() < 2.0


def tilted(viewmats: list[np.ndarray], points: np.ndarray) -> tuple[np.ndarray, np.ndarray, Similarity]:
    """The flight in a frame of its own, as a reconstruction has it."""
    _, s = scattered(4)
    s = Similarity(0.05, s.rotation, np.array([3.0, -1, 2]))
    moved = []
    for v in viewmats:
        rotation = v[:3, :3] @ s.rotation.T
        centre = s.of_points((-v[:3, :3].T @ v[:3, 3])[None])[0]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ centre
        moved.append(matrix)
    return np.array(moved), s.of_points(points), s


def ground(seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    points = np.column_stack([generator.uniform(-20, 20, (600, 2)), generator.normal(0, 0.05, 600)])
    points[:150, 2] = generator.uniform(2, 12, 150)
    return points


def fixes(viewmats: list[np.ndarray], noise_m: float) -> list[Position | None]:
    """Where satellites place the cameras: metres turned into degrees near 50 N, 8 E."""
    centres = np.array([-v[:3, :3].T @ v[:3, 3] for v in viewmats])
    centres = centres + np.random.default_rng(7).normal(size=centres.shape) * noise_m
    return [Position(50 + c[1] / 111_229.0, 8 + c[0] / 71_696.0, 100 + c[2]) for c in centres]


def test_with_satellites_the_world_is_east_north_up_in_metres() -> None:
    viewmats = aerial.arc(12, 170)
    cameras, points, _ = tilted(viewmats, ground())
    world = find_world(cameras, points, fixes(viewmats, 0.3), None, 0)
    assert (world.unit, world.up_from) == ("metres", "satellite positions")
    placed = world.to_world.of_points(points)
    spread = ground()[:, :2].std(axis=0)
    assert placed[:, :2].std(axis=0) == pytest.approx(spread, rel=0.03)
    assert abs(np.median(placed[150:, 2])) < 0.5
    assert world.to_world.scale == pytest.approx(20.0, rel=0.03)
    assert world.gnss_error_m is not None
    assert world.gnss_error_m < 1.5


@pytest.mark.parametrize(("frames", "noise_m", "is_used"), [(12, 1.0, True), (12, 30.0, False), (4, 100.0, False)])
def test_positions_that_contradict_the_cameras_are_not_used(frames: int, noise_m: float, is_used: bool) -> None:
    viewmats = aerial.arc(frames, 170)
    cameras, points, _ = tilted(viewmats, ground())
    world = find_world(cameras, points, fixes(viewmats, noise_m), None, 0)
    assert world.unit == ("metres" if is_used else "unit")
    assert (world.gnss_error_m is None) != is_used
    assert any("satellite positions are not used: they contradict the cameras, by" in n for n in world.notes) != is_used
    if not is_used:
        placed = world.to_world.of_points(points)
        assert placed[150:, 2].std() * 20 / world.to_world.scale < 0.1


def test_an_altitude_beside_satellite_positions_is_not_used_which_is_told() -> None:
    viewmats = aerial.arc(12, 170)
    cameras, points, _ = tilted(viewmats, ground())
    world = find_world(cameras, points, fixes(viewmats, 0.3), 500.0, 0)
    distance = viewing_distance(np.array(viewmats), ground())
    assert world.to_world.scale == pytest.approx(20.0, rel=0.03)
    (note,) = world.notes
    assert note.startswith("--altitude 500 is not used: the scale is known, by which that distance is ")
    assert float(note.split()[-2]) == pytest.approx(distance, rel=0.03)


def test_on_a_straight_flight_the_ground_says_where_up_is() -> None:
    viewmats = [
        aerial.look(np.array([x, -8.0, aerial.ALTITUDE_M]), np.array([x, 1.5, 0.0])) for x in np.linspace(-30, 30, 10)
    ]
    cameras, points, _ = tilted(viewmats, ground())
    world = find_world(cameras, points, fixes(viewmats, 0.3), None, 0)
    assert "too straight" in world.up_from
    placed = world.to_world.of_points(points)
    assert placed[150:, 2].std() < 0.2
    assert world.to_world.scale == pytest.approx(20.0, rel=0.03)


def test_without_satellites_the_ground_is_level_and_the_unit_is_no_metre() -> None:
    viewmats = aerial.arc(9)
    cameras, points, _ = tilted(viewmats, ground())
    world = find_world(cameras, points, [None] * 9, None, 0)
    assert world.unit == "unit"
    placed = world.to_world.of_points(points)
    distance = 1 / (world.to_world.scale * 0.05)  # metres of the flight to a unit
    assert placed[150:, 2].std() * distance < 0.1
    assert placed[:150, 2].min() > 0
    # Half the fixes within some metres of each other: too short a flight to measure a scale with.
    near = [None if p is None else Position(50.0, 8.0, 100.0) for p in fixes(viewmats, 0)]
    world = find_world(cameras, points, near, None, 0)
    assert world.unit == "unit"
    assert "satellite positions are not used: the flight spans 0.0 m by them" in world.notes[0]
    # So many have a fix that the rest of the flight could be anywhere.
    world = find_world(cameras, points, [*fixes(viewmats, 0)[:2], *[None] * 7], None, 0)
    assert world.notes == ("satellite positions are not used: 2 of 9 frames have one, too few",)


def test_a_kept_world_is_scaled_by_an_altitude_only_where_it_has_no_unit() -> None:
    viewmats = np.array(aerial.arc(9))
    points = ground()
    distance = viewing_distance(viewmats, points)
    for is_metric, altitude_m, scale, unit in (
        (True, None, 1, "metres"),
        (False, None, 1, "unit"),
        (False, 84.0, 84 / distance, "metres"),
        (True, 84.0, 1, "metres"),
    ):
        world = kept_world(viewmats, points, "transforms.json", is_metric, altitude_m)
        assert (world.to_world.scale, world.unit) == (pytest.approx(scale), unit)
        assert ("--altitude 84 is not used" in "".join(world.notes)) == (is_metric and altitude_m is not None)
        assert np.array_equal(world.to_world.rotation, np.eye(3))


def test_key_frames_close_loops_and_distances_double() -> None:
    found = pairs(40, 3, 5)
    assert {j - i for i, j in found if i == 0} >= {1, 2, 3, 6, 12, 24, 39}
    assert {(0, 39), (0, 20), (20, 39)} <= set(found)
    assert found == sorted(set(found))
    assert pairs(2, 3, 8) == [(0, 1)]


def test_undistortion_keeps_straight_what_is_straight_at_its_true_place() -> None:
    """Points of the scene, drawn through a distorting lens with a principal point of its own, then undistorted."""
    camera = pycolmap.Camera(
        model="OPENCV", width=640, height=480, params=[500.0, 505, 330, 228, -0.12, 0.03, 0.001, -0.002]
    )
    pinhole = pinhole_of([camera], 2000)
    assert pinhole.K[0, 0] == pytest.approx(500)
    directions = np.array([[x, y, 1.0] for x in (-0.4, -0.1, 0.25, 0.4) for y in (-0.3, 0.0, 0.3)])
    shown = camera.img_from_cam(directions)
    image = np.zeros((480, 640, 3), np.uint8)
    for x, y in shown:
        # A blob whose centre of mass lies at the point; OpenCV's pixel centres are whole numbers.
        cv2.circle(
            image, (round((x - 0.5) * 256), round((y - 0.5) * 256)), 5 * 256, (255, 255, 255), -1, cv2.LINE_AA, 8
        )
    undistorted = Undistortion(camera, pinhole).sampled(image)
    assert undistorted.shape == (pinhole.height, pinhole.width, 3)
    expected = directions @ pinhole.K.T
    assert np.allclose(pinhole_pixels(camera, pinhole, np.asarray(shown)), expected[:, :2], atol=1e-6)
    for x, y in expected[:, :2]:
        window = undistorted[int(y) - 12 : int(y) + 13, int(x) - 12 : int(x) + 13, 0].astype(float)
        rows, columns = np.mgrid[int(y) - 12 : int(y) + 13, int(x) - 12 : int(x) + 13]
        found = ((columns + 0.5) * window).sum() / window.sum(), ((rows + 0.5) * window).sum() / window.sum()
        assert found == pytest.approx((x, y), abs=0.25)
    # Every pixel shows something that the lens has seen.
    corners = np.array([[0, 0], [pinhole.width, 0], [0, pinhole.height], [pinhole.width, pinhole.height]], float)
    rays = np.column_stack([(corners - pinhole.K[:2, 2]) / [pinhole.K[0, 0], pinhole.K[1, 1]], np.ones(4)])
    seen = camera.img_from_cam(rays)
    assert (seen >= -1e-3).all()
    assert (seen <= [640.001, 480.001]).all()


def test_boxes_are_undistorted_as_the_pictures_are() -> None:
    """The mask of a box, undistorted as a picture is, fills what the box becomes; cut off where the frame ends."""
    camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=[500.0, 320, 240, -0.15])
    pinhole = pinhole_of([camera], 480)
    boxes = np.array([[40.0, 60, 120, 80], [500, 380, 100, 60], [300, 220, 40, 40], [-50, -50, 30, 30]])
    mapped = pinhole_boxes(camera, pinhole, boxes / 2, (320, 240))  # of a source of half the size
    for (left, top, width, height), box in zip(boxes[:3].astype(int), mapped[:3], strict=True):
        mask = np.zeros((480, 640), np.uint8)
        mask[top : top + height, left : left + width] = 255
        rows, columns = np.nonzero(Undistortion(camera, pinhole).mask(mask))
        around = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert np.allclose(box, around, atol=1.5)
    assert mapped[3, 0] == mapped[3, 2]  # nothing of it is seen


def test_a_pinhole_camera_is_left_as_it_is() -> None:
    camera = pycolmap.Camera(model="PINHOLE", width=64, height=48, params=[50.0, 51, 30, 25])
    pinhole = pinhole_of([camera], 64)
    assert (pinhole.width, pinhole.height) == (64, 48)
    assert np.array_equal(pinhole.K, [[50, 0, 30], [0, 51, 25], [0, 0, 1]])
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    assert np.array_equal(Undistortion(camera, pinhole).sampled(image), image)


@dataclass(frozen=True)
class Count(StepResult):
    found: int
    at: tuple[int, ...] = ()


def count(name: str, settings: int, run: Callable[[Path, Progress], Count]) -> Step[Count]:
    return Step(name, settings, run, Count)


def test_steps_go_on_where_they_were_stopped(tmp_path: Path) -> None:
    def workspace() -> Workspace:
        return Workspace(tmp_path / "work", lambda *_: lambda *_: None)

    def stopped(folder: Path, _: object) -> Count:
        (folder / "half.txt").write_text("half")
        raise KeyboardInterrupt

    first = workspace()
    with pytest.raises(KeyboardInterrupt):
        first.run(count("a", 1, stopped))

    def goes_on(folder: Path, _: object) -> Count:
        return Count(folder, len(list(folder.glob("half.txt"))), (1, 2))

    made = workspace().run(count("a", 1, goes_on))
    assert made == Count(tmp_path / "work/a", 1, (1, 2))  # in the folder where its files have come to lie
    assert workspace().run(count("a", 1, stopped)) == made  # read, not made again
    # Under other settings, what was stopped is of no use.
    with pytest.raises(KeyboardInterrupt):
        workspace().run(count("a", 2, stopped))
    assert workspace().run(count("a", 3, goes_on)).found == 0


def test_a_step_recorded_by_another_version_is_repeated(tmp_path: Path) -> None:
    def make(found: int) -> Count:
        workspace = Workspace(tmp_path / "work", lambda *_: lambda *_: None)
        return workspace.run(count("a", 1, lambda folder, _: Count(folder, found)))

    make(1)
    record = tmp_path / "work/a/done.json"
    written = record.read_text()
    record.write_text(written.replace('"at"', '"places"'))
    assert make(2).found == 2
    record.write_text(record.read_text().replace('"result": {', '"result": {"more": 3, '))
    assert make(4).found == 2  # a field that is no longer read does no harm


def test_a_repeated_step_repeats_all_after_it(tmp_path: Path) -> None:
    ran: list[str] = []

    def run(settings: list[int]) -> None:
        workspace = Workspace(tmp_path / "work", lambda *_: lambda *_: None)
        for name, value in zip("abc", settings, strict=True):

            def one(folder: Path, _: object, name: str = name) -> Count:
                ran.append(name)
                return Count(folder, 0)

            workspace.run(count(name, value, one))

    for settings, expected in (([1, 1, 1], "abc"), ([1, 1, 1], ""), ([1, 2, 1], "bc"), ([1, 2, 2], "c")):
        ran.clear()
        run(settings)
        assert "".join(ran) == expected
    (tmp_path / "work/a/done.json").write_text("{damaged")
    ran.clear()
    run([1, 2, 2])
    assert "".join(ran) == "abc"

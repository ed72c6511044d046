"""`aa4d capture` on a small flight with true cameras: from frames to a capture that training reads."""

from __future__ import annotations

import base64
import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from aa4d.capture import colmap
from aa4d.capture.advice import field_of_view_advice, no_model_advice
from aa4d.capture.focal import map_globally
from aa4d.capture.make import make_capture
from aa4d.capture.orientation import umeyama
from aa4d.capture.reader import read_capture, read_images
from aa4d.capture.report import _view
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.selection import told
from aa4d.capture.selfcheck import check_capture
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.truth import moving_mask
from aa4d.capture.workspace import Progress, Workspace
from aa4d.capture.writing import Cloud
from aa4d.errors import InputError
from tests.capture import aerial

QUICK = replace(PRESETS["fast"], features=800, longest_px=320, window=3, keyframes=4)
SETTINGS = CaptureSettings("test", QUICK, Selection(source_fps=10.0), movers="off", threads=1)


class Watch:
    """Which steps ran, and which were done before."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.skipped: list[str] = []

    def __call__(self, name: str, was_done: bool) -> Progress:
        (self.skipped if was_done else self.ran).append(name)
        return lambda *_: None


def make(source: Path, out: Path, settings: CaptureSettings = SETTINGS, watch: Watch | None = None) -> CaptureSummary:
    return make_capture(source, out, settings, None, watch or Watch())


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return aerial.write(tmp_path_factory.mktemp("flight") / "frames", aerial.pictures(aerial.arc()))


@pytest.fixture(scope="module")
def made(flight: Path) -> CaptureSummary:
    return make(flight, flight.parent / "capture")


def pose_errors(folder: Path, truth: list[np.ndarray]) -> tuple[float, float]:
    """Root mean square distance (metres) and mean angle (degrees) after the best similarity."""
    capture = read_capture(folder)
    ranks = [int(Path(frame.name).stem) for frame in capture.frames]
    found = np.array([f.viewmat for f in capture.frames])
    true = np.array([truth[i] for i in ranks])
    centres, true_centres = (-np.einsum("nji,nj->ni", v[:, :3, :3], v[:, :3, 3]) for v in (found, true))
    s = umeyama(centres, true_centres)
    distance = np.sqrt(((s.of_points(centres) - true_centres) ** 2).sum(axis=1).mean())
    turned = found[:, :3, :3] @ s.rotation.T
    cosines = (np.einsum("nij,nij->n", turned, true[:, :3, :3]) - 1) / 2
    return float(distance), float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean())


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
    import pycolmap

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


def test_nothing_is_done_twice(made: CaptureSummary, flight: Path) -> None:
    watch = Watch()
    before = (made.folder / "capture.json").read_bytes()
    again = make(flight, made.folder, watch=watch)
    assert watch.ran == []
    assert (made.folder / "capture.json").read_bytes() == before
    assert again.seconds == made.seconds


def test_a_changed_setting_repeats_what_depends_on_it(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    watch = Watch()
    smaller = make(flight, folder, replace(SETTINGS, size_px=160), watch)
    assert watch.ran == ["pictures", "capture"]
    assert max(read_capture(smaller.folder).camera.width, read_capture(smaller.folder).camera.height) <= 160
    assert pose_errors(folder, aerial.arc())[0] == pytest.approx(pose_errors(made.folder, aerial.arc())[0])


def test_repeated_from_scratch_the_cameras_are_the_same(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    again = make(flight, tmp_path / "again")
    first, second = read_capture(made.folder), read_capture(again.folder)
    for a, b in zip(first.frames, second.frames, strict=True):
        assert np.allclose(a.viewmat, b.viewmat, atol=1e-6)


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


def test_a_known_field_of_view_is_kept(flight: Path, tmp_path: Path) -> None:
    made = make(flight, tmp_path / "capture", replace(SETTINGS, fov_deg=50.0))
    # That of the undistorted frames is a little less: their edges are cut.
    assert 46 < made.fov_deg <= 50.1
    document = json.loads((made.folder / "work/cameras/done.json").read_text())
    assert document["result"]["attempts"] == 1
    assert made.advice == ()
    assert "Nothing looks wrong" in made.report.read_text()


def test_over_flat_ground_a_found_field_of_view_is_doubted(made: CaptureSummary) -> None:
    """Its roofs are too small and too low to count: every pair of frames passes for pictures of a plane."""
    (line,) = made.advice
    pairs = json.loads((made.folder / "work/matches/done.json").read_text())["result"]["verified"]
    assert line.what.startswith(f"The field of view, {made.fov_deg:.0f} degrees, is doubtful")
    assert "give --fov" in line.what
    assert f"{pairs} of {pairs} pairs look like pictures of one plane" in line.why
    assert f"The {made.fov_deg:.0f} degrees that were found here can be far off" in line.why
    html = made.report.read_text()
    assert "give --fov" in html
    assert "pairs look like pictures of one plane" in html
    assert "taken for moving" not in html  # --movers off


def test_the_field_of_view_is_doubted_where_the_frames_do_not_tell_it() -> None:
    assert field_of_view_advice({"PLANAR": 60, "CALIBRATED": 40}, 60.0, False) == []
    assert field_of_view_advice({"PLANAR": 50, "PANORAMIC": 45, "UNCALIBRATED": 5}, 60.0, False) != []
    # An impossible one was found, and the guess was taken.
    (line,) = field_of_view_advice({"PLANAR": 60, "CALIBRATED": 40}, 64.0, True)
    assert "The 64 degrees that are the usual ones, taken because the frames gave impossible ones, can" in line.why


def test_a_wrong_field_of_view_is_suspected_where_nothing_comes_out() -> None:
    assert "--fov" not in no_model_advice({"CALIBRATED": 9}, False)
    assert no_model_advice({"CALIBRATED": 9}, True).endswith("or --fov is not the camera's: leave it out")


def test_the_field_of_view_is_found(made: CaptureSummary) -> None:
    assert made.fov_deg == pytest.approx(2 * np.degrees(np.arctan(160 / aerial.FOCAL)), abs=1.5)


def test_the_report_needs_nothing_else(made: CaptureSummary) -> None:
    html = made.report.read_text()
    assert "<canvas" in html
    assert "9 of 9 frames have a pose" in html
    size = read_capture(made.folder).camera
    assert f"px in frames of {size.width}x{size.height}" in html
    assert not re.search(r'(src|href)="(?!data:)', html)


def test_what_the_command_tells(made: CaptureSummary, capsys: pytest.CaptureFixture[str]) -> None:
    from aa4d.commands.capture import tell

    world = replace(made.world, unit="metres", scale_from="satellite positions", gnss_error_m=0.344)
    tell(replace(made, folder=Path("my flight"), world=world, movers="boxes (UAVDT), 2 % of the pixels masked"))
    said = capsys.readouterr().out
    assert "scale: metres (satellite positions, the cameras 0.34 m from theirs (median))\n" in said
    assert "movers: boxes (UAVDT), 2 % of the pixels masked\n" in said
    assert "next:    aa4d train 'my flight' --out RUN\n" in said
    assert said.count("give --fov") == 1
    assert "pictures of one plane" not in said
    tell(replace(made, used=4 * made.frames))
    assert "next:    what the advice says, before you train on it\n" in capsys.readouterr().out


def test_many_notes_of_one_kind_are_one() -> None:
    few, many = ([(f"{i}.jpg", f"damage {i}") for i in range(count)] for count in (3, 31))
    assert told(few) == [f"{i}.jpg left out: damage {i}" for i in range(3)]
    assert told(many) == ["31 frames (0.jpg, 1.jpg, ... 30.jpg) left out, the first because: damage 0"]


def test_the_reports_view_holds_cloud_and_cameras_in_its_middle() -> None:
    generator = np.random.default_rng(0)
    cloud = Cloud(generator.uniform(-5, 5, (2000, 3)), np.zeros((2000, 3), np.uint8), np.ones(2000), np.arange(2000))
    centers = np.array([[60.0, y, 40.0] for y in np.linspace(-3, 3, 8)])  # all on one side, from far away
    right, down, ahead = (np.tile(axis, (8, 1)) for axis in np.eye(3))
    shown = _view(cloud, centers, right, down, ahead, PinholeCamera(320, 240, aerial.K))
    points, frusta = (np.frombuffer(base64.b64decode(shown[k]), "<f4").reshape(-1, 3) for k in ("points", "frusta"))
    assert np.linalg.norm(frusta.reshape(8, 5, 3)[:, 0], axis=1).max() <= 1.001
    assert (np.linalg.norm(points, axis=1) <= 1.001).mean() > 0.9
    middle = np.median(points, axis=0) + frusta.reshape(8, 5, 3)[:, 0].mean(axis=0)
    assert np.linalg.norm(middle) < 0.25  # about as far on one side as on the other


def test_another_input_or_other_things_in_the_folder_are_refused(
    made: CaptureSummary, flight: Path, tmp_path: Path
) -> None:
    other = aerial.write(tmp_path / "other", aerial.pictures(aerial.arc(4)))
    with pytest.raises(InputError, match=r"holds a capture of .*frames; choose a new folder"):
        make(other, made.folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="no unfinished work of `aa4d capture`"):
        make(flight, tmp_path / "mine")
    with pytest.raises(InputError, match="no unfinished work of `aa4d capture`"):
        make(flight, tmp_path / "new/../mine")  # a way round through a folder that is not there yet
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_two_processes_do_not_make_one_capture(flight: Path, tmp_path: Path) -> None:
    """The second is refused, whatever the first has written by then, and takes nothing away."""
    refusals = []

    class Second(Watch):
        def __call__(self, name: str, was_done: bool) -> Progress:
            with pytest.raises(InputError, match="another process is making a capture there; wait for it"):
                make(flight, tmp_path / "capture")
            refusals.append(name)
            return super().__call__(name, was_done)

    assert make(flight, tmp_path / "capture", watch=Second()).frames == 9
    assert refusals == ["frames", "features", "matches", "cameras", "pictures", "capture"]
    # What a killed process has left without its record is taken over.
    (tmp_path / "killed/work").mkdir(parents=True)
    (tmp_path / "killed/.lock").touch()
    outside = replace(SETTINGS, selection=Selection(source_fps=10.0, start_s=60))
    with pytest.raises(InputError, match="no frame lies between"):
        make(flight, tmp_path / "killed", outside)
    assert list((tmp_path / "killed").iterdir()) == []


def test_a_refusal_leaves_an_earlier_capture_as_it_was(flight: Path, made: CaptureSummary, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    outside = replace(SETTINGS, selection=Selection(source_fps=10.0, start_s=60))
    with pytest.raises(InputError, match="no frame lies between"):
        make(flight, folder, outside)
    assert list((folder / "work").glob("*.part")) == []
    assert (folder / "capture.json").read_bytes() == (made.folder / "capture.json").read_bytes()
    assert read_images(read_capture(folder), [0]).shape[0] == 1
    assert make(flight, folder).frames == 9


def contents(folder: Path) -> dict[str, bytes]:
    """Of all that a capture is made of: not the report, whose seconds differ, and not work/."""
    files = [p for p in folder.rglob("*") if p.is_file() and p.relative_to(folder).parts[0] not in ("work", ".lock")]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files if p.name not in ("report.html", "cost.json")}


@pytest.mark.parametrize(
    ("damage", "ran"),
    [
        (lambda c: (c / "capture.json").unlink(), ["capture"]),
        (lambda c: (c / "capture.json").write_text("{"), ["capture"]),
        (lambda c: (c / "points.ply").write_bytes(b""), ["capture"]),
        (lambda c: shutil.rmtree(c / "sparse"), ["capture"]),
        (
            lambda c: (c / "transforms.json").write_text((c / "transforms.json").read_text().replace("1", "2")),
            ["capture"],
        ),
        (lambda c: (c / "frames/000003.png").unlink(), ["pictures", "capture"]),
        (lambda c: (c / "frames/000003.png").write_bytes(b""), ["pictures", "capture"]),  # in work/ too, by its link
        (lambda c: (c / "work/pictures/000003.png").write_bytes(b""), ["pictures", "capture"]),
        (lambda c: shutil.rmtree(c / "work/cameras/model"), ["cameras", "pictures", "capture"]),
    ],
)
def test_a_damaged_capture_is_mended(
    flight: Path, made: CaptureSummary, tmp_path: Path, damage: Any, ran: list[str]
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    for link in (folder / "work/pictures").glob("*.png"):  # which copying has taken apart
        link.unlink()
        os.link(folder / "frames" / link.name, link)
    damage(folder)
    watch = Watch()
    make(flight, folder, watch=watch)
    assert watch.ran == ran
    assert contents(folder) == contents(made.folder)


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


def test_stopped_and_continued(flight: Path, tmp_path: Path) -> None:
    """Ctrl-C in the command itself: exit code 130, and the next call repeats no finished step."""
    command = [sys.executable, "-m", "aa4d.cli", "capture", str(flight), "--out", str(tmp_path / "c")]
    command += ["--preset", "fast", "--movers", "off", "--threads", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    features = tmp_path / "c/work/features/done.json"
    deadline = time.monotonic() + 60
    while not features.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "the same command continues" in said
    assert not (tmp_path / "c/capture.json").exists()
    stamp = os.stat(features).st_mtime_ns
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert finished.returncode == 0, finished.stderr
    assert "features: done before" in finished.stdout
    assert "next:    aa4d train" in finished.stdout
    assert os.stat(features).st_mtime_ns == stamp


def test_ctrl_c_while_a_stage_starts_stops_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """An exception out of Thread.start would leave the stage running when the process ends, which aborts it."""
    start, ended = threading.Thread.start, threading.Event()

    def interrupted_start(thread: threading.Thread) -> None:
        start(thread)
        signal.raise_signal(signal.SIGINT)

    def stage(token: Any) -> None:
        deadline = time.monotonic() + 30
        while not token.is_cancelled and time.monotonic() < deadline:
            time.sleep(0.01)
        if token.is_cancelled:
            ended.set()

    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    with pytest.raises(KeyboardInterrupt):
        colmap.run(stage, tmp_path)
    assert ended.is_set()


def test_a_disk_that_fills_while_a_stage_runs_stops_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """COLMAP would wait for its database for ever, or take the failed write for success."""
    free, ended = [1 << 30, 1 << 30, 800_000], threading.Event()

    def disk_usage(_: Path) -> SimpleNamespace:
        return SimpleNamespace(free=free.pop(0) if len(free) > 1 else free[0])

    def stage(token: Any) -> None:
        deadline = time.monotonic() + 30
        while not token.is_cancelled and time.monotonic() < deadline:
            time.sleep(0.01)
        if token.is_cancelled:
            ended.set()

    monkeypatch.setattr(shutil, "disk_usage", disk_usage)
    with pytest.raises(OSError, match="less than 4 MiB are free") as full:
        colmap.run(stage, tmp_path)
    assert full.value.errno == errno.ENOSPC
    assert ended.is_set()
    with pytest.raises(OSError, match="less than 32 MiB are free"):
        colmap.run(stage, tmp_path)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize("left", [0, 20])
def test_a_model_that_could_not_be_written_is_noticed_and_the_same_command_heals(
    made: CaptureSummary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, left: int
) -> None:
    import pycolmap

    from aa4d.capture.clip import Clip, ClipFrame
    from aa4d.capture.mapping import adopt_step

    model = pycolmap.Reconstruction(made.folder / "work/cameras/model")
    frames = tuple(ClipFrame(model.image(i).name, "", 0.0, 0, 1.0, None) for i in model.reg_image_ids())
    clip = Clip(tmp_path, 320, 240, (320, 240), frames, ())

    def adopted() -> Any:
        return Workspace(tmp_path / "work", lambda *_: lambda *_: None).run(adopt_step(clip, model))

    write = pycolmap.Reconstruction.write

    def write_until_full(self: Any, folder: Path) -> None:
        write(self, folder)
        (folder / file).write_bytes((folder / file).read_bytes()[:left])

    monkeypatch.setattr(pycolmap.Reconstruction, "write", write_until_full)
    with pytest.raises(InputError, match=r"no space is left .*COLMAP could not write its model.*the same command"):
        adopted()
    monkeypatch.undo()
    whole = adopted()
    assert whole.read().num_reg_images() == len(frames)
    # As an earlier version left it: recorded as done.
    (whole.folder / "model" / file).write_bytes(b"")
    record = json.loads((whole.folder / "done.json").read_text())
    record["sizes"][f"model/{file}"] = 0
    (whole.folder / "done.json").write_text(json.dumps(record))
    assert adopted().read().num_points3D() == model.num_points3D()


def test_the_global_mapper_finds_the_field_of_view_and_its_failure_is_none(
    made: CaptureSummary, tmp_path: Path
) -> None:
    database, images = made.folder / "work/matches/database.db", made.folder / "work/frames"
    names = sorted(path.name for path in images.glob("*.png"))
    before = database.read_bytes()
    model = map_globally(database, images, names, 0, 1, tmp_path / "found")
    assert model.num_reg_images() == len(names)
    camera = next(iter(model.cameras.values()))
    assert camera.mean_focal_length() == pytest.approx(aerial.FOCAL, rel=0.05)
    assert database.read_bytes() == before
    assert map_globally(database, images, ["nobody.png"], 0, 1, tmp_path / "nothing") is None
    (tmp_path / "empty.db").touch()
    assert map_globally(tmp_path / "empty.db", images, names, 0, 1, tmp_path / "broken") is None


def test_a_global_mapper_that_fails_on_a_full_disk_is_no_verdict_on_the_footage(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "empty.db").touch()
    ended = SimpleNamespace(returncode=1)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=800_000))
    with pytest.raises(OSError, match="less than 4 MiB are free"):
        map_globally(tmp_path / "empty.db", tmp_path, ["a.png"], 0, 1, tmp_path / "found")


def test_features_go_on_in_the_middle(made: CaptureSummary, tmp_path: Path) -> None:
    """What a killed run has stored is kept, and all frames stay those of one camera."""
    import pycolmap

    from aa4d.capture import features
    from aa4d.capture.clip import Clip, ClipFrame

    work = made.folder / "work/frames"
    files = sorted(p.name for p in work.glob("*.png"))
    frames = tuple(ClipFrame(file, file, i / 10, i, 1.0, None) for i, file in enumerate(files))
    whole = Clip(work, aerial.WIDTH, aerial.HEIGHT, (aerial.WIDTH, aerial.HEIGHT), frames, ())
    features.extract(replace(whole, frames=frames[:3]), None, QUICK, None, 1, tmp_path, lambda *_: None)
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        before = {i.name: database.read_keypoints(i.image_id) for i in database.read_all_images()}
    found = features.extract(whole, None, QUICK, None, 1, tmp_path, lambda *_: None)
    assert len(found.features) == 9
    assert min(found.features) > 100
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        assert database.num_cameras() == 1
        for image in database.read_all_images():
            if image.name in before:
                assert np.array_equal(database.read_keypoints(image.image_id), before[image.name])
    assert set(before) == set(files[:3])


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
